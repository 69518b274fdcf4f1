"""Motions by finite elements in isorod's own implicit steps, beside isorod's."""

import numpy as np
import pytest
from conftest import straight

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from comparisons.fem.known import Steps
from comparisons.fem.rods import solve
from comparisons.fem.rods.run import mesh_of
from isorod import dynamics
from isorod.errors import InputError
from isorod.material import LinearElastic, NeoHookean
from isorod.model import Body, Model, SectionLoad, Support
from isorod.space import Space

HEIGHT = 4.0
GIVEN = {"end_time": 2.0, "time_step": 0.25, "outputs": 4, "damping": 0.2, "integrator": "implicit"}


def bar(law, force):
    space = Space(straight(8, height=HEIGHT), elements=4, degree=3, section_degree=3)
    body = Body(space, law, density=2.0)
    return Model([body], [Support.end(space, "start")], loads=[SectionLoad(force)])


def both(model):
    theirs = solve(model, mesh_of(model, 2), "dynamics", steps=Steps(**GIVEN))
    return theirs, dynamics.solve(model, **GIVEN)


@pytest.mark.parametrize(
    "law, force, error",
    [
        (LinearElastic(100.0, 0.0), (0.0, 0.0, 3.0), 2e-3),
        pytest.param(NeoHookean(100.0, 0.3), (2.0, 0.0, 1.0), 0.01, marks=pytest.mark.slow),
    ],
    ids=["along", "bent"],
)
def test_a_loaded_bar_moves_as_isorods(law, force, error):
    theirs, ours = both(bar(law, force))
    assert theirs.times == pytest.approx(ours.times)
    moved, wanted = (np.array([one.at(0, "end") for one in way]) for way in (theirs, ours))
    assert moved == pytest.approx(wanted, abs=error * np.abs(wanted).max())
    assert theirs.reactions == pytest.approx(ours.reactions, abs=4.0 * error * np.abs(ours.reactions).max())


def test_steps_are_those_that_isorod_takes():
    steps = Steps(2.0, 0.3, 4, ramp=0.5, integrator="implicit")
    assert (steps.count, steps.step) == (2, 0.25)
    assert [steps.level(time) for time in (0.0, 0.25, 0.6)] == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("given", [{"integrator": "explicit", "time_step": 0.1}, {"integrator": "implicit"}])
def test_other_steps_are_refused(given):
    with pytest.raises(InputError, match="integrator: got explicit steps"):
        Steps(1.0, **given)
