"""Finite elements of rods: mean supports, springs, bearings, line loads, moments that turn, heat; and on ranks."""

import numpy as np
import pytest
from conftest import straight

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from mpi4py import MPI

from comparisons.fem.known import Steps
from comparisons.fem.rods import solve
from comparisons.fem.rods.elements import Elements
from comparisons.fem.rods.loads import nodal
from comparisons.fem.rods.means import Moment
from comparisons.fem.rods.run import mesh_of
from isorod import modal, statics
from isorod.errors import InputError
from isorod.material import LinearElastic, NeoHookean
from isorod.material.thermal import Thermal
from isorod.model import Body, Model, Support
from isorod.model.load import LineLoad, PointLoad, SectionLoad
from isorod.model.mean import MeanSupport
from isorod.space import Space

HEIGHT = 8.0
LAW = NeoHookean(100.0, 0.3)
ALONG = LineLoad((0.0, 0.05, 0.02))


def rod(elements=4):
    return Space(straight(8, height=HEIGHT), elements=elements, degree=3, section_degree=3)


def beam(loads=(), law=LAW, more=()):
    """On a fork and a pin, its middle on springs."""
    space = rod()
    held = [
        MeanSupport.end(space, "start", "fork"),
        MeanSupport.end(space, "end", "pin", "xy", (0.0, 0.1, 0.0)),
        MeanSupport.spring(space, 0.5, (0.0, 2.0, 0.0), (3.0, 0.0, 0.0)),
        *more,
    ]
    return Model([Body(space, law, 1.0)], held, loads=list(loads))


@pytest.mark.slow
def test_a_beam_on_means_and_springs_is_isorods():
    model = beam([ALONG, SectionLoad(moment=(2.0, 0.0, 0.0))])
    theirs, ours = solve(model, mesh_of(model, 2), "statics"), statics.solve(model)
    for u in (0.5, 1.0):
        assert theirs.at(0, u) == pytest.approx(ours.at(0, u), abs=5e-3 * np.abs(ours.at(0, 0.5)).max())
    assert theirs.reactions == pytest.approx(ours.reactions, abs=5e-3 * np.abs(ours.reactions).max())
    assert theirs.moments == pytest.approx(ours.moments, abs=5e-3 * np.abs(ours.moments).max())
    # Nothing gives way, and all is in balance.
    assert theirs.reactions.sum(axis=0) == pytest.approx(-HEIGHT * np.array(ALONG.per_length), abs=1e-7)
    assert theirs.at(0, 1.0)[1] == pytest.approx(ours.at(0, 1.0)[1], abs=2e-4)


def test_modes_of_a_beam_in_bearings_are_isorods():
    space = rod(8)
    held = [MeanSupport.bearing(space, u) for u in (0.125, 0.875)] + [MeanSupport.end(space, "start", "fork", "z")]
    model = Model([Body(space, LinearElastic(100.0, 0.3), 1.0)], held)
    theirs, ours = solve(model, mesh_of(model, 2), "modal", modes=4), modal.solve(model, 4)
    assert theirs.rigid == 0 and theirs.below == 4
    assert theirs.frequencies == pytest.approx(ours.frequencies, rel=5e-3)


def test_a_line_load_is_its_force_and_moment():
    model = beam([ALONG])
    mesh = mesh_of(model)
    force = nodal(Elements(mesh, [model.bodies[0].space.rod]), model, ALONG)
    assert force.sum(axis=0) == pytest.approx(HEIGHT * np.array(ALONG.per_length))
    along = mesh.points[:, 2] @ force
    assert along == pytest.approx(0.5 * HEIGHT**2 * np.array(ALONG.per_length))


def test_forces_of_a_moment_have_it_wherever_the_section_is_and_their_derivative():
    load = SectionLoad(moment=(0.3, -0.2, 0.5))
    model = beam([load])
    mesh = mesh_of(model)
    one, rng = Moment(Elements(mesh, [model.bodies[0].space.rod]), model, load), np.random.default_rng(2)
    nodes = mesh.points @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + 0.05 * rng.normal(size=mesh.points.shape)
    out = np.zeros_like(nodes)
    one.add_forces(nodes, out)
    assert out.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    assert -np.cross(nodes, out).sum(axis=0) == pytest.approx(load.moment)
    way, ends = rng.normal(size=nodes.shape), []
    for side in (1e-6, -1e-6):
        ends.append(np.zeros_like(nodes))
        one.add_forces(nodes + side * way, ends[-1])
    slope = one.stiffness(nodes).tocsr() @ way.ravel()
    assert slope == pytest.approx(((ends[0] - ends[1]) / 2e-6).ravel(), abs=1e-6 * np.abs(slope).max())


def test_a_heated_bar_between_smooth_walls_has_its_free_strain_times_e_a():
    space = rod()
    walls = [Support.end(space, end, "z") for end in ("start", "end")]
    held = [*walls, MeanSupport.end(space, "start", "fork", "xy"), MeanSupport.end(space, "end", "pin", "xy")]
    law = Thermal(LinearElastic(100.0, 0.3), 1e-5, 40.0)
    found = solve(Model([Body(space, law)], held), mesh_of(Model([Body(space, law)], held), 2), "statics", load_steps=2)
    assert found.reactions[1] == pytest.approx([0.0, 0.0, -100.0 * np.pi * 4e-4], rel=2e-3, abs=1e-8)
    # What no wall holds expands by that and by what the walls press out of it.
    assert found.at(0, 0.5, (1.0, 0.0))[0] == pytest.approx(1.3 * 4e-4, rel=2e-3)


def test_a_force_at_a_place_has_no_limit():
    model = beam([PointLoad(0.5, (0.0, 1.0, 0.0))])
    with pytest.raises(InputError, match=r"load 0: a force at a place has no limit to compare with; spread it"):
        solve(model, None, "statics")


def test_means_in_motion_are_refused():
    with pytest.raises(InputError, match="support 0: finite elements have mean motions and springs in statics and mod"):
        solve(beam(), None, "dynamics", steps=Steps(1.0, 0.1, integrator="implicit"))


def test_means_of_several_laws_are_refused():
    space = Space(straight(8, height=4.0).with_rings((0.0, 0.5, 1.0)), section_degree=2)
    body = Body(space, [LAW, LinearElastic(10.0, 0.3)], 1.0)
    with pytest.raises(InputError, match="support 0: finite elements have mean motions of sections of one law alone"):
        solve(Model([body], [MeanSupport.end(space, "start", "fixed")]), None, "statics")


def test_supports_that_move_by_time_are_refused():
    space = rod()
    held = [Support.end(space, "start", displacement=(1.0, 0.0, 0.0), history=[[0.0, 0.0], [1.0, 1.0]])]
    with pytest.raises(InputError, match="support 0: finite elements have no supports that move by time"):
        solve(Model([Body(space, LAW, 1.0)], held), None, "dynamics", steps=Steps(1.0, 0.1, integrator="implicit"))


def same_on_ranks():
    """On several ranks: what they find together is what each finds alone."""
    space = rod(2)
    clamped, body = [Support.end(space, "start")], Body(space, LAW, 1.0)
    every = {
        "means": (beam([ALONG, SectionLoad(moment=(2.0, 0.0, 0.0))]), "statics", {}),
        "modes": (Model([body], clamped), "modal", {"modes": 4}),
        "motion": (
            Model([body], clamped, loads=[SectionLoad((0.1, 0.0, 0.0))]),
            "dynamics",
            {"steps": Steps(1.0, 0.5, 2, integrator="implicit")},
        ),
        "pressures": (
            Model([Body(space, NeoHookean(100.0, 0.5))], clamped, loads=[SectionLoad((0.1, 0.0, 1.0))]),
            "statics",
            {},
        ),
    }
    for name, (model, analysis, more) in every.items():
        mesh = mesh_of(model)
        one, several = (solve(model, mesh, analysis, comm=comm, **more) for comm in (MPI.COMM_SELF, MPI.COMM_WORLD))
        if analysis == "modal":
            assert several.frequencies == pytest.approx(one.frequencies, rel=1e-9), name
            continue
        if analysis == "dynamics":
            one, several = one[-1], several[-1]
        assert (several.dofs, several.unknowns) == (one.dofs, one.unknowns), name
        largest = np.abs(one.displacement).max()
        assert several.displacement == pytest.approx(one.displacement, abs=1e-9 * largest), name
        assert several.reactions == pytest.approx(one.reactions, abs=1e-9 * np.abs(one.reactions).max()), name


@pytest.mark.slow
def test_ranks_find_what_one_finds(on_ranks):
    on_ranks(2, "test_fem_means.same_on_ranks()")
