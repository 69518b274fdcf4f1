"""Laws of small strains joined to others: as they take a rotation for a strain, each strains the other."""

import warnings

import pytest

from isorod import (
    Body,
    LateralSurface,
    LinearElastic,
    Model,
    SectionLoad,
    Space,
    StVenantKirchhoff,
    Support,
    Tie,
    circle,
    rounded_rectangle,
    statics,
    straight,
)

E, NU, LENGTH = 1000.0, 0.3, 20.0


def layered(core, sheath, force):
    """Return how far the end of a cantilever of two layers goes aside."""
    rod = straight(LENGTH).sweep(circle(8)).with_rings([0.0, 0.7, 1.0])
    space = Space(rod, section_degree=3, degree=4, elements=4)
    push = SectionLoad.end(space, "end", (0.0, force, 0.0))
    body = Body(space, [[core(E, NU), sheath(E, NU)]] * rod.axis.elements)
    return statics.solve(Model([body], [Support.end(space, "start")], loads=[push])).at(0, 1.0)[1]


def strips(first, second, force):
    """Return the same of two strips that are welded along."""
    section = rounded_rectangle(12, 2.0, 1.0, 0.4)
    rods = [straight(start=(0.0, y, 0.0), end=(0.0, y, LENGTH)).sweep(section) for y in (-0.5, 0.5)]
    spaces = [Space(rod, section_degree=2, degree=3, elements=4) for rod in rods]
    push = SectionLoad.end(spaces[0], "end", (0.0, force, 0.0))
    weld = Tie(LateralSurface(0, touching=True), LateralSurface(1))
    ends = [Support.end(space, "start", body=b) for b, space in enumerate(spaces)]
    bodies = [Body(space, law(E, NU)) for space, law in zip(spaces, (first, second), strict=True)]
    return statics.solve(Model(bodies, ends, loads=[push], ties=[weld])).at(0, 1.0)[1]


@pytest.mark.parametrize("made", [layered, strips])
def test_what_joins_a_law_of_small_strains_to_another_is_warned_of_before_it_counts(made):
    """At 2.6 degrees such a rod is a third too stiff; between two laws of a kind there is nothing to warn of."""
    warned = []
    for force in (0.002, 0.1):
        exact = made(StVenantKirchhoff, StVenantKirchhoff, force)
        for laws in ((LinearElastic, StVenantKirchhoff), (LinearElastic, LinearElastic)):
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                found = made(*laws, force)
            lines = [str(one.message) for one in said if "joined to it, does not" in str(one.message)]
            assert lines or found == pytest.approx(exact, rel=5e-3)
            warned.append(len(lines))
    assert warned == [0, 0, 1, 0]
