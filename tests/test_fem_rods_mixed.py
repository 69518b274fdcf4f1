"""Nearly incompressible rods by finite elements with pressures: exact answers, and isorod's own."""

import numpy as np
import pytest
from conftest import straight
from refused import refused

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from comparisons.fem.known import refuse, with_pressures
from comparisons.fem.rods import solve
from comparisons.fem.rods.run import mesh_of
from isorod import statics
from isorod.material import LinearElastic, NeoHookean
from isorod.model import Body, Contact, Model, Pressure, Support
from isorod.model.contact import Plane
from isorod.space import Space

HEIGHT, E = 4.0, 3.0


def space_of(rings=None):
    rod = straight(8, height=HEIGHT)
    return Space(rod if rings is None else rod.with_rings(rings), elements=4, degree=3, section_degree=4)


def bar(law=None, way=(0.0, 0.0, 0.0), ends=("start", "end"), rings=None, **more):
    """Return a bar along z that is held at its ends, the last of which moves."""
    space = space_of(rings)
    supports = [Support.end(space, end, displacement=way if end == "end" else (0.0, 0.0, 0.0)) for end in ends]
    return Model([Body(space, law or NeoHookean(E, 0.5), density=2.0)], supports, **more)


@pytest.mark.parametrize("law", [NeoHookean(E, 0.5), LinearElastic(E, 0.5)], ids=["finite", "small"])
def test_pressure_all_round_what_cannot_give_way_is_its_stress(law):
    """Ends cannot move and the volume cannot change: nothing moves, and all of the bar is under the pressure."""
    model = bar(law, loads=[Pressure(0.7)])
    solution = solve(model, mesh_of(model), "statics")
    assert np.abs(solution.displacement).max() < 1e-9
    stress = solution.stress(0, [0.1, 0.5], [[0.3, -0.2], [0.0, 0.9]])
    assert stress == pytest.approx(np.broadcast_to(-0.7 * np.eye(3), stress.shape), abs=1e-8)


@pytest.mark.parametrize("way", [(0.0, 0.0, 0.5), (0.6, 0.0, 0.0)])
def test_an_incompressible_bar_is_isorods(way):
    model = bar(way=way)
    one, other = solve(model, mesh_of(model, 2), "statics"), statics.solve(model)
    size = np.abs(other.reactions).max()
    assert one.reactions == pytest.approx(other.reactions, abs=0.006 * size)
    assert one.energy(0) == pytest.approx(other.energy(0), rel=0.01)
    assert np.linalg.det(one.deformation_gradient(0, 0.5)) == pytest.approx(1.0, abs=2e-3)
    assert one.stress(0, 0.5) == pytest.approx(other.stress(0, 0.5), abs=0.008)


def test_core_and_sheath_of_which_one_is_incompressible():
    laws = [NeoHookean(E, 0.5), NeoHookean(1.0, 0.3)]
    model = bar(laws, (0.0, 0.0, 0.4), rings=(0.0, 0.6, 1.0))
    one, other = solve(model, mesh_of(model, 2), "statics"), statics.solve(model)
    assert one.reactions[1, 2] == pytest.approx(other.reactions[1, 2], rel=0.01)


def test_pressures_act_in_the_rods_that_have_them_alone():
    """Of two rods apart each is as if it were alone."""
    alone = [bar(law, (0.0, 0.0, 0.4)) for law in (NeoHookean(E, 0.5), NeoHookean(E, 0.3))]
    both = [one.bodies[0] for one in alone]
    ends = [
        Support.end(body.space, end, displacement=(0.0, 0.0, 0.4 * (end == "end")), body=k)
        for k, body in enumerate(both)
        for end in ("start", "end")
    ]
    model = Model(both, ends)
    assert with_pressures(model) == [0]
    forces = np.concatenate([solve(one, mesh_of(one), "statics").reactions for one in alone])
    assert solve(model, mesh_of(model), "statics").reactions == pytest.approx(forces, abs=1e-7)


def test_torsion_of_an_incompressible_bar_has_its_exact_frequency():
    model = bar(LinearElastic(E, 0.5), ends=("start",))
    frequencies = solve(model, mesh_of(model), "modal", modes=6).frequencies
    exact = np.sqrt(E / 3.0 / 2.0) / (4.0 * HEIGHT)
    assert np.abs(frequencies / exact - 1.0).min() < 2e-3


test_what_there_is_not_is_refused_before_there_is_a_mesh = refused(
    ({}, "dynamics", "material of body 0: nearly incompressible"),
    ({"contacts": [Contact(0, Plane((0.0, -2.0, 0.0), (0.0, 1.0, 0.0)), friction=0.3)]}, "statics", "friction"),
    by=lambda more, analysis: refuse(bar(**more), analysis),
)
