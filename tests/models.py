"""Models of all that the assembly has to sum, which several test files take: spins, ties, laws, pressures, contact."""

from itertools import product

import numpy as np
from conftest import straight

from isorod import Axis, LinearElastic, Muscle, NeoHookean, Rod, Space, circle
from isorod.model import Body, BodyForce, Model, Pressure, SectionLoad, Spin, Support
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring
from isorod.tensors import rotation


def spring(rule="full"):
    return Spring(preset="paper", coils=1, section_points=4, elements_per_turn=4, quadrature=rule).model()


def ring():
    """A closed rod, held at a few nodes and not in every direction."""
    space = Space.paper(Ring(section_points=5).rod(), elements=8, degree=3)
    supports = [
        Support([0, 1], "xy"),
        Support([2, space.nodes - 1], "z"),
        Support([4 * 5], "xyz", (0.05, -0.02, 0.1)),
    ]
    return Model([Body(space, NeoHookean(100.0, 0.3))], supports)


def two_bodies():
    """A spring that is free to turn about z at one end, and a ring of another law; the bodies do not touch."""
    wire = Space.paper(Spring(helix="paper", coils=1, section_points=3).rod(), degree=2, elements=4, quadrature="paper")
    hoop = Space.paper(Ring(section_points=4).rod(), elements=8, degree=2, continuity=0)
    supports = [
        Support.end(wire, "start"),
        Support.end(wire, "end", "z", (0.0, 0.0, 0.3)),
        Support([0, 2, 3], "xyz", body=1),
        Support([hoop.nodes // 2], "y", (0.0, 0.2, 0.0), body=1),
    ]
    return Model([Body(wire, NeoHookean(50.0, 0.2)), Body(hoop, LinearElastic(80.0, 0.35))], supports)


def spinning(speed=0.1, elements=4):
    """A clamped spring rotating about a line askew to everything."""
    space = Space.paper(Spring(helix="paper", coils=1, section_points=4).rod(), elements=elements, order=2)
    supports = [Support.end(space, "start", displacement=(0.3, -0.2, 0.5)), Support([space.nodes - 1], "x")]
    spin = Spin((0.3 * speed, -0.4 * speed, speed), (1.0, 2.0, -3.0))
    return Model([Body(space, NeoHookean(5e3, 0.3), 2.0)], supports, spin)


def tendon_and_muscle():
    """A wire of two laws whose fibres run along it and act more and more with the load factor."""
    space = Space.paper(Spring(helix="paper", coils=1, section_points=4).rod(), elements=4)
    tendon = NeoHookean(90.0, 0.3)
    muscle = Muscle(30.0, 0.4, sigma_max=40.0, activation=0.8)
    supports = [Support.end(space, "start"), Support.end(space, "end", "z", (0.0, 0.0, 0.1))]
    supports.append(Support([space.nodes - 1], "xy"))
    return Model([Body(space, [tendon, muscle, muscle, tendon])], supports)


def tied():
    """Loads on a spring whose end turns, held in one direction and tied in the others."""
    space = Space.paper(Spring(helix="paper", coils=1, section_points=4).rod(), elements=4)
    end = Support.end(space, "end", "y", (0.0, 0.2, 0.0), turn=(0.1, 0.2, -0.1), tied="xz")
    loads = [BodyForce((0.0, 0.0, 1e-2)), SectionLoad((0.0, 0.1, 0.2), u=0.3)]
    return Model([Body(space, NeoHookean(100.0, 0.3))], [Support.end(space, "start"), end], loads=loads)


MODELS = {
    "tendon and muscle": tendon_and_muscle,
    "spinning": spinning,
    "spring": spring,
    "paper rule": lambda: spring("paper"),
    "ring": ring,
    "two bodies": two_bodies,
    "tied": tied,
}


def gradients_of_functions(table):
    """Gradients of the functions of elements at their points, by place, ``(elements, t, q, 3, functions)``."""
    plane = np.einsum("etj,qdi->etqdji", table.axial, table.section[:, :2])
    axis = np.einsum("etj,qi->etqji", table.slopes, table.section[:, 2])[:, :, :, None]
    slopes = np.concatenate([plane, axis], axis=3).reshape(*table.weights.shape, 3, -1)
    return np.swapaxes(table.inverse, -1, -2) @ slopes


def bend(rings=(0.6, 1.0)):
    """A quarter of a bend, its sections turned with it."""
    axis = Axis(2, np.repeat([0.0, 1.0], 3), np.ones(3))
    turns = [rotation((0.0, angle, 0.0)) for angle in (0.0, 0.3, 0.6)]
    return Rod.sweep(circle(8, 1.0), axis, [(0.0, 0.0, 0.0), (0.0, 0.0, 3.0), (1.5, 0.0, 5.0)], turns).with_rings(rings)


def pipe(*pressures, rings=(0.6, 1.0), law=None):
    """A bent one, its ends held: the tangent of pressures that follow is symmetric."""
    space = Space(bend(rings), degree=2, section_degree=2, quadrature="auto", elements=2)
    loads = [Pressure(p, surface, follows=True) for p, surface in pressures]
    held = Support.end(space, "start"), Support.end(space, "end")
    return Model([Body(space, law or NeoHookean(1.0, 0.3))], held, loads=loads)


PIPES = {
    "pressed inside": lambda: pipe((0.02, "inner")),
    "pressed on both sides": lambda: pipe((0.3, "outer"), (-0.1, "inner")),
    "rubber pressed inside": lambda: pipe((0.02, "inner"), law=NeoHookean(1.0, 0.5)),
    "rubber in layers pressed inside": lambda: pipe(
        (0.02, "inner"), rings=(0.5, 0.7, 1.0), law=[NeoHookean(1.0, 0.5), NeoHookean(3.0, 0.3)]
    ),
}

SECTIONS = [{"order": 1}, {"order": 2}, {"section_degree": 3}]


def mixed(kind, nu, sections):
    """A bar with pressures whose end is moved while it spins."""
    E = 2.0 * (1.0 + nu)
    law = Muscle(E, nu, sigma_max=0.5, m1=0.4, m2=0.5, activation=0.6) if kind is Muscle else kind(E, nu)
    space = Space.paper(straight(n=6, height=3.0), elements=2, degree=3, **sections)
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.1, 0.2, 0.3))
    return Model([Body(space, law, 1.0, "mixed")], ends, spin=Spin((0.1, 0.0, 0.2)))


# Each law with each ratio, and with each kind of section functions once.
MIXED = {
    f"mixed {kind.__name__} {nu} {SECTIONS[(i + j) % 3]}": (
        lambda kind=kind, nu=nu, sections=SECTIONS[(i + j) % 3]: mixed(kind, nu, sections)
    )
    for (i, kind), (j, nu) in product(enumerate((NeoHookean, LinearElastic, Muscle)), enumerate((0.3, 0.499999, 0.5)))
}


def in_rings(rings, laws):
    """A bar with a hole or in layers, with pressures, whose end is moved while it spins."""
    space = Space(straight(n=6, height=3.0).with_rings(rings), elements=2, degree=2, section_degree=2)
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.1, 0.2, 0.3))
    return Model([Body(space, laws, 1.0, "mixed")], ends, spin=Spin((0.1, 0.0, 0.2)))


MIXED |= {
    "mixed with a hole": lambda: in_rings((0.5, 1.0), NeoHookean(3.0, 0.5)),
    "mixed in layers": lambda: in_rings((0.0, 0.6, 1.0), [NeoHookean(3.0, 0.5), LinearElastic(2.0, 0.3)]),
}
