"""Load factors of scene files at which models buckle, by closed forms: columns, shafts, strips, springs, pipes."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from isorod import NeoHookean, Space, buckling, circle, files, modal, straight
from isorod.command import solving
from isorod.model import Body, Model, Pressure, Support
from isorod.output.section_properties import section_properties
from isorod.space import choice

COLUMN = """title = "a column"
analysis = {{{analysis}}}
[rod.column]
curve = {{straight = {length}}}
section = {{{section}}}
law = {{{law} = {{E = 2.1e5, nu = {nu}}}}}
density = 1.0
[support.foot]
end = "start"
"""
PRESSED = """[load.press]
end = "end"
force = [{side}, 0.0, {force}]
"""
GUIDED = """[support.head]
end = "end"
components = "xy"
tied = "z"
"""
TWISTED = GUIDED + "rotation = [0.0, 0.0, {turn}]\n"
ROUND = {"analysis": "buckling = {modes = 2}", "section": "circle = 1.0", "law": "NeoHookean", "nu": 0.0, "side": 0.0}
E, AREA, SECOND = 2.1e5, np.pi, np.pi / 4.0


@pytest.fixture
def scene(tmp_path):
    def make(text, **changes):
        path = tmp_path / "scene.toml"
        path.write_text(text.format(**ROUND | changes))
        return files.find(str(path))

    return make


def solved(one, **settings):
    return solving.solve(one, one.settings() | settings)[0]


def column(wave):
    """Return the force at which a column of unit radius and ``nu = 0`` bends into waves ``cos(wave z)``.

    Of a beam that shears and shortens, ``P (1 + P / kGA - P / EA) = E' I wave^2``; the neo-Hookean modulus along it is
    ``E' = E (1 + P / EA)`` to first order, and k = 6/7 the shear factor of a circle.
    """
    axial, shear = E * AREA, 6.0 / 7.0 * E / 2.0 * AREA
    return brentq(
        lambda p: p * (1.0 + p / shear - p / axial) - E * (1.0 + p / axial) * SECOND * wave**2, 0.0, 0.2 * axial
    )


@pytest.mark.parametrize("length", [20.0, 400.0])
@pytest.mark.parametrize(("more", "halves"), [("", 0.5), (GUIDED, 2.0)])
def test_columns_buckle_at_eulers_load_less_what_they_shear(more, halves, length, scene):
    found = solved(scene(COLUMN + more + PRESSED, length=length, force=-1000.0))
    force = 1000.0 * found.factors
    assert force == pytest.approx(column(halves * np.pi / length), rel=1e-3)
    euler = E * SECOND * (halves * np.pi / length) ** 2
    assert force == pytest.approx(euler, rel=1e-4 if length == 400.0 else 0.01)
    # Of a round bar two at once; shapes whose largest displacement is 1.
    assert found.below == [0, 0] and found.residuals.max() < 1e-5
    place = 1.0 if more == "" else 0.5
    assert [one["u"] for one in found.places] == pytest.approx([place, place], abs=1e-3)
    assert np.linalg.norm(found[0].at(0, place, (0.0, 0.0))) == pytest.approx(1.0, rel=1e-2)
    assert found.loads[0] == "force of load 0" and found.loads[1] == pytest.approx(force)


def test_the_linear_factor_is_that_of_the_stress_alone(scene):
    """Engesser's with the work of the stress along the axis: ``P (1 + P / kGA + P / EA) = EI wave^2``."""
    one = scene(COLUMN + GUIDED + PRESSED, length=20.0, force=-1000.0)
    axial, shear, euler = E * AREA, 6.0 / 7.0 * E / 2.0 * AREA, E * SECOND * (np.pi / 10.0) ** 2
    linear = brentq(lambda p: p * (1.0 + p / shear + p / axial) - euler, 0.0, 2.0 * euler)
    found = solved(one, linear_at=0.0)
    assert 1000.0 * found.factors == pytest.approx(linear, rel=5e-3)
    assert found.about == "the state of rest (linear)" and found.estimate() is None
    whole = solved(one)
    assert whole.linear == pytest.approx(found.factors, rel=1e-9)
    # The nearer to the factor, the nearer is what is told.
    exact = whole.factors[0]
    errors = [abs(solved(one, linear_at=share * exact).factors[0] / exact - 1.0) for share in (0.5, 0.9, 0.99)]
    assert errors[0] > 10.0 * errors[1] > 100.0 * errors[2]


@pytest.mark.parametrize(
    ("text", "changes", "key", "size"),
    [
        (COLUMN + PRESSED, {"length": 20.0, "nu": 0.3}, "force", -1.0),
        (COLUMN + TWISTED, {"length": 50.0, "nu": 0.3}, "turn", 660.0),
        (COLUMN + PRESSED, {"length": 60.0, "section": "ellipse = {a = 3.0, b = 0.5}", "force": 0.0}, "side", 1.0),
    ],
)
def test_the_lowest_frequency_is_zero_there(text, changes, key, size, scene):
    """Of the loaded state, by the modal analysis, from below."""
    factor = solved(scene(text, **changes | {key: size})).factors[0]
    shares, squares = np.array([0.98, 0.985, 0.99, 0.995]), []
    for share in shares:
        loaded = scene(text, **changes | {key: share * factor * size})
        squares.append(modal.solve(loaded.model(), 6).eigenvalues[0])
    assert np.polyval(np.polyfit(np.array(squares) / squares[0], shares, 3), 0.0) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_a_shaft_buckles_when_it_is_twisted(nu, scene):
    """Greenhill's problem with clamped ends: ``M l / EI = 8.98682``; the turn is ``M l / GJ``."""
    critical = 2.0 * brentq(lambda x: np.sin(x) - x * np.cos(x), 4.0, 4.6)
    found = solved(scene(COLUMN + TWISTED, length=200.0, nu=nu, turn=np.degrees(1.0)))
    assert found.factors / (1.0 + nu) == pytest.approx(critical, rel=1e-3)
    assert found.loads[0] == "rotation of support 1, degrees"


def strip(length, more):
    """A strip with a section of 0.1 by 1, and its stiffnesses: torsion, bending across and along it."""
    section = "rounded_rectangle = {width = 0.1, height = 1.0, corner_radius = 0.025}"
    return COLUMN + more, {"length": length, "section": section, "nu": 0.3, "analysis": "buckling = {}"}


def test_a_strip_buckles_sideways_under_end_moments(scene):
    """Clamped against sideways turns: ``2 pi sqrt(B C) / l``, over the root of what it bends before."""
    text, changes = strip(20.0, GUIDED + "rotation = [-1.0, 0.0, 0.0]\n")
    text = text.replace('end = "start"\n', 'end = "start"\nrotation = [1.0, 0.0, 0.0]\n')
    text = text.replace("density", "space = {{section_degree = 6, elements = 4, degree = 4}}\ndensity")
    model = scene(text, **changes).model()
    found = buckling.solve(model)
    *_, torsion, first, second = np.diag(section_properties(model.bodies[0]).stiffness)
    weak, strong = sorted((first, second))
    before = np.sqrt((1.0 - weak / strong) * (1.0 - torsion / strong))
    moment = found.factors[0] * strong * np.radians(2.0) / 20.0
    assert moment == pytest.approx(2.0 * np.pi / 20.0 * np.sqrt(weak * torsion) / before, rel=5e-3)
    assert found.loads is None


def cantilever(weak, strong, torsion, length):
    """Return the force on the end of a strip at which it buckles sideways, bent before (Kirchhoff's rod, by shooting).

    ``4.0126 sqrt(B C) / l^2`` (Prandtl, Michell 1899) where it does not bend before.
    """
    flat = 4.0126 * np.sqrt(weak * torsion) / length**2

    def aside(share):
        force = share * flat

        def planar(s, y):
            return [y[1] / strong, force * np.cos(y[0])]

        def end(first):
            return solve_ivp(planar, (0.0, length), [0.0, first], rtol=1e-9, atol=1e-12).y[1, -1]

        first = brentq(end, -1.5 * force * length, 0.0)

        def motions(s, y):
            bend, moment = y[1] / strong, y[1]
            across, along = force * np.cos(y[0]), -force * np.sin(y[0])
            found = planar(s, y[:2])
            for a2, a3, m2, m3 in (y[2:6], y[6:]):
                k2, k3 = m2 / weak, m3 / torsion
                found += [k2 + bend * a3, k3 - bend * a2]
                found += [-moment * k3 + bend * m3 - across * a3 + along * a2, moment * k2 - bend * m2]
            return found

        start = [0.0, first, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
        y = solve_ivp(motions, (0.0, length), start, rtol=1e-9, atol=1e-12).y[:, -1]
        return y[4] * y[9] - y[5] * y[8]

    return flat * brentq(aside, 0.8, 1.2)


@pytest.mark.slow
def test_a_strip_buckles_sideways_under_a_force_on_its_end(scene):
    """The clamp, which holds its warping, makes it shorter by about a quarter of its height."""
    factors = []
    for length in (60.0, 120.0):
        text, changes = strip(length, PRESSED.replace("{side}, 0.0, {force}", "0.0, {side}, 0.0"))
        model = scene(text, **changes | {"side": 1e-3}).model()
        *_, torsion, first, second = np.diag(section_properties(model.bodies[0]).stiffness)
        exact = cantilever(*sorted((first, second)), torsion, length)
        factors.append(1e-3 * buckling.solve(model).factors[0] / exact)
    assert factors[1] == pytest.approx(1.0, abs=1e-2)
    assert 2.0 * factors[1] - factors[0] == pytest.approx(1.0, abs=5e-3)


def ring(thickness, follows):
    """A slice of a pipe of mean radius 1 between planes, held in the mean: its ovals are not."""
    outer = 1.0 + thickness / 2.0
    rod = straight(1.0).sweep(circle(8, outer)).with_rings([(1.0 - thickness / 2.0) / outer, 1.0])
    space = Space(rod, elements=1, degree=2, **choice.buckling(rod))
    # The first functions across are 1, x and y.
    ones = np.arange(space.layers) * space.layer_nodes
    held = [Support.end(space, end, "z") for end in ("start", "end")]
    held += [Support(ones, "xy"), Support(ones + 2, "x")]
    return Model([Body(space, NeoHookean(1000.0, 0.0))], held, loads=[Pressure(1.0, follows=follows)])


def test_a_ring_under_pressure_buckles_into_an_oval():
    """Under water ``3 EI / R^3`` (Levy 1884), under forces that keep their directions ``4 EI / R^3`` (Boresi 1955).

    The former on the outer radius alone; the latter are ``1 + t / 2R`` as many there, and turn the wall as much.
    """
    thickness = 0.1
    stiffness = 1000.0 * thickness**3 / 12.0
    found = buckling.solve(ring(thickness, True), modes=2)
    assert found.factors / stiffness == pytest.approx(3.0, rel=5e-3)
    dead = buckling.solve(ring(thickness, False), modes=2).factors
    assert dead / stiffness == pytest.approx(4.0 / (1.0 + thickness / 2.0) ** 2, rel=5e-3)


SPRING = """title = "a spring between plates"
analysis = {{buckling = {{linear_at = {at}}}}}
[rod.wire]
curve = {{helix = {{radius = 5.0, pitch = 4.0, turns = 20}}}}
section = {{circle = {{radius = 0.5}}}}
law = {{NeoHookean = {{E = 2.0e5, nu = 0.3}}}}
[support.lower]
end = "start"
[support.upper]
end = "end"
displacement = [0.0, 0.0, -16.0]
"""


def haringx(length, diameter, nu):
    """Return by which share of its length a spring between plates is shorter when it buckles (EN 13906-1)."""
    ratio = 0.5 / (1.0 + nu)
    inside = 1.0 - (1.0 - ratio) / (0.5 + ratio) * (np.pi * diameter / (0.5 * length)) ** 2
    return 0.5 / (1.0 - ratio) * (1.0 - np.sqrt(inside))


@pytest.mark.slow
def test_a_spring_between_plates_buckles_where_haringx_says(scene):
    """Its ends press beside its axis, so that it goes aside before: the factor is told a twentieth short of it."""
    found = solved(scene(SPRING, at=0.95))
    assert found.factors[0] * 16.0 / 80.0 == pytest.approx(haringx(80.0, 10.0, 0.3), rel=5e-3)
    assert solved(scene(SPRING, at=0.8)).factors[0] == pytest.approx(found.factors[0], rel=0.01)


PIPE = """title = "a long pipe under water"
analysis = "buckling"
[rod.pipe]
curve = {{straight = 60.0}}
section = {{circle = {{radius = 1.05}}}}
rings = [0.904761904761905, 1.0]
law = {{NeoHookean = {{E = 1000.0, nu = 0.0}}}}
[support.one]
end = "start"
[support.two]
end = "end"
[load.water]
pressure = 0.25
follows = true
"""


@pytest.mark.slow
def test_a_long_pipe_collapses_as_a_ring_does(scene):
    """Clamped at both ends, which still make it stiffer by a few thousandths."""
    found = solved(scene(PIPE))
    assert found.factors[0] == pytest.approx(1.0, rel=5e-3) and found.factors[0] > 1.0
    assert found.loads[1] == pytest.approx(0.25 * found.factors)
