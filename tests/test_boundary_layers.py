"""Stresses near ends, by the spaces that are chosen, and what is said of their error."""

import warnings

import numpy as np
import pytest

from isorod import Body, InputError, LinearElastic, Model, NeoHookean, Pressure, Support, helix, statics, straight
from isorod.files.scene import FileScene
from isorod.geometry import section
from isorod.space import Space, choice

E, NU = 200.0, 0.3
G = E / (2.0 * (1.0 + NU))
STRAIN = 1e-5
RING = np.stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)], axis=1)


def bar(length, load, law=None, **numbers):
    """Return a round bar of radius 1 that is clamped at its start and moved at its end."""
    space = Space(straight(length).sweep(section.circle(8)), **numbers)
    angle = STRAIN * length
    moved = {
        "tension": {"displacement": (0.0, 0.0, STRAIN * length)},
        "torsion": {"turn": (0.0, 0.0, angle)},
        # Round the circle of that curvature.
        "bending": {"turn": (angle, 0.0, 0.0), "displacement": (0.0, -0.5 * angle * length, 0.0)},
        "shear": {"displacement": (0.0, STRAIN * length, 0.0)},
    }[load]
    ends = Support.end(space, "start"), Support.end(space, "end", **moved)
    return statics.solve(Model([Body(space, law or LinearElastic(E, NU))], ends))


def exact(solution, load, length, u):
    """Return Cauchy's stress of Saint-Venant's solutions at the surface, by the forces and moments at the end."""
    result = np.zeros((u.size, len(RING), 3, 3))
    x, y = RING.T
    force, moment = solution.reactions[1], solution.moments[1]
    if load == "tension":
        result[..., 2, 2] = force[2] / np.pi
    elif load == "torsion":
        tau = 2.0 * moment[2] / np.pi
        result[..., 0, 2], result[..., 1, 2] = -tau * y, tau * x
    else:
        # The moment about x rises along the bar with the transverse force.
        there = moment[0] - force[1] * length * (1.0 - u)[:, None]
        result[..., 2, 2] = 4.0 / np.pi * there * y
        if load == "shear":
            # Timoshenko & Goodier, Theory of Elasticity, section 123: the circle.
            inertia, q = np.pi / 4.0, force[1]
            a, b = (3.0 + 2.0 * NU) / (8.0 * (1.0 + NU)), (1.0 - 2.0 * NU) / (3.0 + 2.0 * NU)
            result[..., 1, 2] = q / inertia * a * (1.0 - y**2 - b * x**2)
            result[..., 0, 2] = -q / inertia * (1.0 + 2.0 * NU) / (4.0 * (1.0 + NU)) * x * y
    upper = np.triu(np.ones((3, 3)), 1)
    return result + np.swapaxes(result * upper, 2, 3)


@pytest.mark.parametrize("length", [8.0, 17.0, 60.0, 200.0])
@pytest.mark.parametrize("load", ["tension", "torsion", "bending", "shear"])
def test_stresses_a_diameter_off_the_ends_are_those_of_saint_venant(length, load):
    """Even elements err by 55 % in tension and 26 % in shear where the bar is long."""
    solution = bar(length, load)
    u = np.linspace(2.0, length - 2.0, 101) / length
    wanted, found = exact(solution, load, length, u), solution.stress(0, u, RING)
    assert np.abs(found - wanted).max() < 0.01 * np.abs(wanted).max()
    error = np.linalg.norm(found - wanted, axis=(2, 3)).max() / np.linalg.norm(wanted, axis=(2, 3)).max()
    # Where it is next to nothing, the small rotation's square is in it.
    assert error < 3.0 * max(solution.errors().stress, 5e-5)


def test_even_elements_ring_and_the_estimate_tells():
    solution = bar(60.0, "tension", elements=4, continuity=0)
    u = np.linspace(2.0, 58.0, 101) / 60.0
    wanted, found = exact(solution, "tension", 60.0, u), solution.stress(0, u, RING)
    error = np.abs(found - wanted).max() / np.abs(wanted).max()
    assert error > 0.1
    assert error / 3.0 < solution.errors().stress < 3.0 * error
    assert solution.errors().work < 1e-3


def test_a_tube_under_pressure_is_lames_a_diameter_off_its_held_end():
    a = 0.7
    rod = straight(30.0).sweep(section.circle(8)).with_rings([a, 1.0])
    space = Space(rod)
    model = Model([Body(space, LinearElastic(E, NU))], [Support.end(space, "start")], loads=[Pressure(1e-5, "inner")])
    solution = statics.solve(model)
    u = np.linspace(2.0, 28.0, 31) / 30.0
    hoop = solution.stress(0, u, [(0.0, 1.0)])[:, 0, 0, 0]
    lame = 1e-5 * a**2 / (1.0 - a**2) * 2.0
    # What an end of a tube does dies away over the root of radius times thickness.
    assert hoop == pytest.approx(lame, rel=0.015)


def test_knots_are_near_ends_and_nowhere_else():
    space = Space(straight(60.0).sweep(section.circle(8)))
    assert 60.0 * np.array(space.knots) == pytest.approx([0.4, 1.6, 5.2, 54.8, 58.4, 59.6])
    assert space.axis.elements == space.elements + 6
    # The stiffness of short elements in a rod like that would be lost in rounding.
    assert Space(straight(3e4).sweep(section.circle(8))).knots == ()
    # Elements as short as that need none; nor have closed rods ends.
    assert Space(straight(1.5).sweep(section.circle(8))).knots == ()
    assert Space(straight(60.0).sweep(section.circle(8)), elements=5).knots == ()
    around = Space(helix(20.0, 5.0, 1).sweep(section.circle(8)))
    length = np.hypot(2.0 * np.pi * 20.0, 5.0)
    assert length * np.array(around.knots[:2]) / around.axis.breaks[-1] == pytest.approx([0.4, 1.6], rel=0.02)


def test_halved_elements_nest():
    space = Space(straight(60.0).sweep(section.circle(8)))
    finer = Space(space.rod, degree=5, section_degree=3, continuity=space.continuity, **choice.halved(space))
    assert finer.axis.elements >= 2 * space.axis.elements
    assert np.isin(space.axis.breaks, finer.axis.breaks).all()
    nodal = np.random.default_rng(1).normal(size=(space.axis.count, 2))
    u = np.linspace(0.0, 1.0, 57)
    moved = space.axis.transfer(finer.axis, nodal)

    def values(axis, points):
        first, functions, _ = axis.local(u)
        return np.einsum("tj,tjc->tc", functions, points[first[:, None] + np.arange(axis.degree + 1)])

    assert values(finer.axis, moved) == pytest.approx(values(space.axis, nodal), abs=1e-11)


@pytest.mark.parametrize("knots", [(0.5,), (0.0,), (0.1, 0.1, 0.1), (1.5,), (0.0, 0.0)])
def test_knots_that_cannot_be(knots):
    with pytest.raises(
        InputError, match=r"knots: got .*, need others than there are, once each \(twice: a kink\), between"
    ):
        Space(straight(60.0).sweep(section.circle(8)), elements=2, knots=knots)


PUSHED = """
analysis = "statics"
[rod.bar]
curve.straight = 40.0
section.circle = 1.0
law = {LinearElastic = {E = 200.0, nu = 0.3}}
[support.foot]
end = "start"
[load.push]
section = 0.37
force = [0.0, 0.0, 0.01]
"""


@pytest.mark.parametrize("more", [{}, {"elements": 4}])
def test_a_load_on_a_section_has_a_kink_if_elements_are_chosen(more, tmp_path):
    """Strains jump there: a diameter off, stresses before it are force over area, beyond it nothing."""
    path = tmp_path / "pushed.toml"
    path.write_text(PUSHED)
    model = FileScene(str(path), **more).model()
    u = np.append(np.linspace(2.0, 12.8, 31), np.linspace(16.8, 38.0, 31)) / 40.0
    stress = statics.solve(model).stress(0, u, RING)[..., 2, 2]
    off = np.abs(stress - np.where(u < 0.37, 0.01 / np.pi, 0.0)[:, None]).max() / (0.01 / np.pi)
    if more:
        assert off > 0.1
    else:
        knots = model.bodies[0].space.knots
        assert knots.count(0.37) == 2
        assert off < 0.01


def test_a_kink_may_be_at_a_knot():
    rod = straight(10.0).sweep(section.circle(8))
    axis = Space(rod, elements=4, degree=5, knots=(0.3, 0.5, 0.5)).axis
    assert np.count_nonzero(axis.knots == 0.5) == 5
    assert np.count_nonzero(axis.knots == 0.3) == 2


TWO = """
analysis = "statics"
[rod.bar]
curve.straight = {length = 40.0, breaks = [0, 0.5, 1], continuity = 0}
section.circle = 1.0
law = [{LinearElastic = {E = 200.0, nu = 0.3}}, {LinearElastic = {E = 50.0, nu = 0.3}}]
[support.foot]
end = "start"
[support.head]
end = "end"
displacement = [0.0, 0.0, 1e-3]
"""


def test_bars_in_series_have_short_elements_where_laws_differ(tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(TWO)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = FileScene(str(path)).model()
    space = model.bodies[0].space
    assert 40.0 * np.array(space.knots) == pytest.approx(
        [0.4, 1.6, 5.2, 14.8, 18.4, 19.6, 20.4, 21.6, 25.2, 34.8, 38.4, 39.6]
    )
    solution = statics.solve(model)
    place = np.linspace(2.0, 38.0, 101)
    u = place[np.abs(place - 20.0) > 2.0] / 40.0
    stress = solution.stress(0, u, RING)[..., 2, 2]
    # Poisson's ratios are the same: what is left of the jump is that of strain along.
    assert stress == pytest.approx(solution.reactions[1, 2] / np.pi, rel=0.012)


def test_the_estimate_sees_what_large_strains_do():
    law = NeoHookean(E, NU)
    rod = straight(30.0).sweep(section.ellipse(8, 2.0, 0.7))

    def solved(space):
        ends = Support.end(space, "start"), Support.end(space, "end", displacement=(3.0, 0.0, 3.0))
        return statics.solve(Model([Body(space, law)], ends))

    found = solved(Space(rod))
    fine = solved(
        Space(rod, elements=10, degree=6, continuity=0, section_degree=6, knots=found.model.bodies[0].space.knots)
    )
    u = np.linspace(4.0, 26.0, 45) / 30.0
    there, better = found.stress(0, u, RING), fine.stress(0, u, RING)
    error = np.linalg.norm(there - better, axis=(2, 3)).max() / np.linalg.norm(better, axis=(2, 3)).max()
    assert error / 3.0 < found.errors().stress < 5.0 * error
    assert found.errors().stress < 0.03


@pytest.mark.parametrize(("integrator", "short"), [("explicit", 0), ("implicit", 6)])
def test_explicit_steps_have_no_short_elements(integrator, short, tmp_path):
    """The shortest one would set the time step."""
    path = tmp_path / "moves.toml"
    _, rest = TWO.split("[rod.bar]")
    text = rest.replace(", breaks = [0, 0.5, 1], continuity = 0", "").replace(
        "law = [{LinearElastic = {E = 200.0, nu = 0.3}}, {LinearElastic = {E = 50.0, nu = 0.3}}]",
        "law = {NeoHookean = {E = 200.0, nu = 0.3}}\ndensity = 1e-3",
    )
    path.write_text(f'[rod.bar]{text}[analysis.dynamics]\nend_time = 1.0\nintegrator = "{integrator}"\n')
    assert len(FileScene(str(path)).model().bodies[0].space.knots) == short


def test_closed_rods_of_several_laws_have_boundary_layers_at_their_joints(tmp_path):
    laws = ", ".join(f"{{NeoHookean = {{E = {modulus}, nu = 0.3}}}}" for modulus in 6 * (100.0, 200.0))
    (tmp_path / "ring.toml").write_text(
        f"""
analysis = "statics"
[rod.ring]
curve = {{polyline = {{points = [[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]], closed = true, fillet = 2.0}}}}
section = {{circle = 0.5}}
law = [{laws}]
"""
    )
    space = FileScene(str(tmp_path / "ring.toml")).model().bodies[0].space
    assert space.rod.closed
    assert space.continuity == 0
    assert len(space.knots) >= 11
