"""Derivatives by numbers of scenes: identities of scale, Taylor's remainder, reciprocity, double frequencies."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from petsc4py import PETSc
from refused import refused

import isorod
from isorod import InputError, choices, files, modal, scenes, statics
from isorod.assembly.formulation import assembler_for
from isorod.design import derivatives, parameters
from isorod.petsc.direct import direct
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring
from isorod.statics.derivatives import Moving, refuse
from isorod.statics.differences import NEAR, PerturbedModels

TIGHT = {"snes_rtol": 1e-13, "snes_atol": 1e-12}

SPRING = Spring(coils=1.25, travel=1.0, nu=0.25, section_degree=3)
BLADE = Blade(elements=4, section_degree=3, degree=3)

BAR = """
[rod.bar]
curve = {straight = 6.0}
section = {ellipse = {a = 0.5, b = 0.5}}
law = {LinearElastic = {E = 2.0e4, nu = 0.3}}
density = 3.0
space = {elements = 4, section_degree = 4, degree = 5}

[support.wall]
end = "start"

[analysis.modal]
modes = 4
"""


def of(scene, comm=PETSc.COMM_SELF, **more):
    analysis = modal if scene.analysis == "modal" else statics
    solution = analysis.solve(scene.model(), comm=comm, **more)
    return derivatives.of(scene, solution).checked()


def logarithmic(found, name, parameter):
    return found.by[parameter][name] * found.parameters[parameter] / found.values[name]


def pulled(solution):
    return float(solution.model.prescribed(1.0).max())


@pytest.fixture(scope="module")
def spring():
    return of(SPRING)


@pytest.fixture(scope="module")
def blade():
    return of(BLADE, modes=4)


def test_a_force_scales_with_the_square_of_lengths_and_with_the_modulus(spring):
    lengths = ("coil_radius", "pitch", "wire_radius", "travel")
    rates = [logarithmic(spring, "force", one) for one in lengths]
    # Each is known to 1e-9 of it, and they are of both signs.
    assert sum(rates) == pytest.approx(2.0, abs=1e-9 * np.abs(rates).sum())
    assert logarithmic(spring, "force", "E") == pytest.approx(1.0, abs=1e-9)
    # Slender limits (Wahl): F = G d^4 s / (8 D^3 n).
    assert logarithmic(spring, "force", "wire_radius") == pytest.approx(4.0, abs=0.1)
    assert logarithmic(spring, "force", "coil_radius") == pytest.approx(-3.0, abs=0.2)


def test_what_turns_far_has_no_kink(tmp_path):
    """A displacement stays the same where all forces grow with the modulus."""
    path = tmp_path / "bent.toml"
    path.write_text("""
[rod.bar]
curve = {chain = [{straight = 30.0}, {arc = {radius = 10.0, angle = 90}}]}
section = {ellipse = {a = 1.0, b = 0.6}}
law = {StVenantKirchhoff = {E = 2000.0, nu = 0.35}}
density = 1e-6
[support.wall]
end = "start"
[load.tip]
end = "end"
force = [0.05, 0.1, 0.0]
[gravity]
acceleration = [0.0, 0.0, -9810.0]
[analysis.statics]
[measure.y]
displacement = "bar"
component = "y"
""")
    found = of(files.find(str(path)))
    forces = ("load.tip.force.0", "load.tip.force.1", "density", "law.StVenantKirchhoff.E")
    names = [one if one.startswith("load") else f"rod.bar.{one}" for one in forces]
    assert abs(logarithmic(found, "y", names[-1])) > 1.0
    assert sum(logarithmic(found, "y", one) for one in names) == pytest.approx(0.0, abs=1e-8)


def test_frequencies_scale_with_lengths_modulus_and_density(blade):
    lengths = sum(logarithmic(blade, "frequencies", one) for one in ("length", "chord"))
    np.testing.assert_allclose(lengths, -1.0, atol=1e-9)
    np.testing.assert_allclose(logarithmic(blade, "frequencies", "E"), 0.5, atol=1e-10)
    np.testing.assert_allclose(logarithmic(blade, "frequencies", "density"), -0.5, atol=1e-10)


@pytest.mark.parametrize("name", ["wire_radius", "nu", "travel", "pitch", "coils"])
def test_the_remainder_of_taylor_is_of_second_order(spring, name):
    """Models beside are on the same discretisation, whole runs of them."""
    with choices.kept() as made:
        begin = statics.solve(SPRING.model(), petsc=TIGHT)
    at, rest = spring.parameters[name], []
    force, rate = (float(one) for one in (SPRING.measure(begin)["force"], spring.by[name]["force"]))
    for share in (0.02, 0.01, 0.005):
        with choices.repeated(made):
            model = replace(SPRING, **{name: at * (1.0 + share)}).model()
        moved = float(SPRING.measure(statics.solve(model, petsc=TIGHT))["force"])
        rest.append(moved - force - rate * at * share)
    orders = np.log2(np.abs(rest[:-1]) / np.abs(rest[1:]))
    np.testing.assert_allclose(orders, 2.0, atol=0.15)


def test_a_force_by_a_constant_is_the_energy_by_both(spring):
    """``dF/dnu = d/ds (dW/dnu at rest of u)``, ``F = dW/ds``: one side is of the equilibrium's motion by nu alone."""
    begin = statics.solve(SPRING.model())
    with choices.kept() as made:
        SPRING.model()

    def explicit(solution):
        energies = []
        for step in (-1e-3, 1e-3):
            with choices.repeated(made):
                model = replace(SPRING, nu=SPRING.nu + step, travel=pulled(solution)).model()
            assembler = assembler_for(model, PETSc.COMM_SELF)
            energies.append(assembler.energy(assembler.state(solution.displacement), 1.0))
        return {"slope": (energies[1] - energies[0]) / 2e-3}

    def make(values):
        return parameters.at(SPRING, values).model()

    found = begin.derivatives(make, {"travel": SPRING.travel}, explicit).checked()
    # The difference by nu is of second order.
    assert float(found.by["travel"]["slope"]) == pytest.approx(float(spring.by["nu"]["force"]), rel=3e-5)


def test_the_largest_stress_goes_along_with_where_it_is(tmp_path):
    """A given length from a wall is another part of a longer bar: as stresses of bars that are solved differ."""
    path = tmp_path / "cantilever.toml"
    path.write_text("""
[rod.bar]
curve = {straight = 6.0}
section = {circle = 0.3}
law = {LinearElastic = {E = 2.0e4, nu = 0.3}}
space = {elements = 6, section_degree = 4, degree = 5}

[support.wall]
end = "start"

[load.tip]
end = "end"
force = [0.01, 0.0, 0.0]

[analysis.statics]

[measure.bending]
stress = "bar"
component = "along"
away = 1.0
""")
    scene, length = files.find(str(path)), "rod.bar.curve.straight"
    found = of(scene)
    bars = [parameters.at(scene, {length: 6.0 * change}) for change in (1.0 - 1e-4, 1.0 + 1e-4)]
    less, more = (bar.measure(statics.solve(bar.model(), comm=PETSc.COMM_SELF))["bending"] for bar in bars)
    assert found.by[length]["bending"] == pytest.approx((more - less) / 12e-4, rel=1e-3)
    assert logarithmic(found, "bending", "rod.bar.section.circle") == pytest.approx(-3.0, rel=5e-3)
    assert logarithmic(found, "bending", "load.tip.force.0") == pytest.approx(1.0, rel=1e-4)


def test_a_bearing_and_a_corner_take_their_knots_along(tmp_path):
    """Where a support stands the axis has a kink, between corners that move: lengths and forces scale together."""
    path = tmp_path / "frame.toml"
    path.write_text("""
[rod.bar]
curve = {polyline = {points = [[0.0, 0.0, 0.0], [0.0, 0.0, 60.0], [0.0, 50.0, 80.0]], fillet = 8.0}}
section = {circle = 2.0}
law = {StVenantKirchhoff = {E = 2.0e5, nu = 0.3}}
[support.wall]
end = "start"
[support.bearing]
section = 27.0
[load.tip]
end = "end"
force = [0.0, 1.0, 0.5]
[analysis.statics]
[measure.sag]
displacement = "bar"
component = "y"
""")
    found = of(files.find(str(path)))
    lengths = [one for one in found.by if "polyline" in one or one.endswith(("circle", "bearing.section"))]
    assert len(lengths) == 6
    rates = [logarithmic(found, "sag", one) for one in lengths]
    # Of a length L, sag = L f(F / E L^2).
    forces = sum(logarithmic(found, "sag", f"load.tip.force.{k}") for k in (1, 2))
    assert sum(rates) == pytest.approx(1.0 - 2.0 * forces, rel=1e-6)
    assert min(map(abs, rates)) > 1e-4


def test_of_double_frequencies_each_has_its_own(tmp_path):
    (tmp_path / "bar.toml").write_text(BAR)
    scene = files.find(str(tmp_path / "bar.toml"))
    found = of(scene, modes=4)
    first = logarithmic(found, "frequencies", "rod.bar.section.ellipse.a")[:2]
    # Bending across the other axis does not see this one, but for shear and rotary inertia.
    np.testing.assert_allclose(first, [0.0, 1.0], atol=0.03)
    other = logarithmic(found, "frequencies", "rod.bar.section.ellipse.b")[:2]
    np.testing.assert_allclose(other, first, atol=1e-6)
    step = 1e-4
    moved = modal.solve(parameters.at(scene, {"rod.bar.section.ellipse.a": 0.5 * (1.0 + step)}).model(), modes=2)
    change = moved.frequencies / found.values["frequencies"][:2] - 1.0
    np.testing.assert_allclose(change / step, first, atol=1e-3)


def test_one_back_substitution_for_a_force_is_as_good_as_one_for_each_number(spring):
    """Of the force of a support ``w^T R`` it is ``(w - K^-1 K w)^T dR/dp``: no motion by the number is known."""
    begin = statics.solve(SPRING.model(), comm=PETSc.COMM_SELF)
    with closing(Moving(begin)) as moving:
        assembler, x = moving.assembler, moving.x
        matrix, pull, adjoint = assembler.matrix(), assembler.vector(), assembler.vector()
        assembler.load_forces(x, 1.0, -1.0, pull)
        assembler.tangent(x, 1.0, matrix)
        ksp = direct(matrix, {"pc_type": "cholesky"}, "test_")
        ksp.solve(pull, adjoint)
        of_support = begin.model.prescribed(1.0)[begin.model.bound]
        beside = PerturbedModels(lambda at: parameters.at(SPRING, at).model(), spring.parameters, begin.model)
        for name in spring.parameters:
            steps, models = beside.models(name, NEAR)
            rates = []
            for model in models:
                other, rest = assembler_for(model, PETSc.COMM_SELF), assembler.vector()
                carried = other.acting(x, 1.0, rest)
                rates.append(carried @ of_support + rest.dot(adjoint))
            found = steps.weights @ (rates - moving.acting @ of_support) / SPRING.travel
            expected = float(spring.by[name]["force"])
            assert found == pytest.approx(expected, abs=1e-9 * abs(float(spring.values["force"]) / steps.size))


def on_two():
    found, alone = of(SPRING, PETSc.COMM_WORLD), of(SPRING)
    for name in found.parameters:
        one, other = (logarithmic(each, "force", name) for each in (found, alone))
        assert one == pytest.approx(other, abs=1e-8)


def test_ranks_find_the_same(on_ranks):
    on_ranks(2, "test_rates.on_two()")


def no_derivative(measure, **at):
    solution = statics.solve(SPRING.model())
    solution.derivatives(lambda values: parameters.at(SPRING, values).model(), at, measure).checked()


def kink(solution):
    """A force that is there from the travel of this model on."""
    return {"kink": max(pulled(solution) - 1.0, 0.0)}


test_what_has_no_derivative_is_refused = refused(
    (lambda: no_derivative(SPRING.measure, travel=0.0), "travel: got 0: a derivative is found by small shares of it"),
    (lambda: no_derivative(kink, travel=1.0), "derivative by travel: there is none here: the slope of kink jumps"),
    (lambda: derivatives.of(scenes.find("ring")(), None), "derivatives: not available in geometry"),
    (lambda: refuse(scenes.find("coil")(coils=1).model()), "derivatives: not available with friction"),
    (
        lambda: parameters.named(SPRING, "radius"),
        "'radius' is no parameter of the scene that can vary; there are: coils",
    ),
)


def test_choices_are_those_of_the_same_model_alone():
    with choices.kept() as made:
        Spring(section_degree=3).rod()
    with choices.repeated(made):
        one = replace(Spring(), coils=3.01).rod()
    assert one.axis.elements == Spring().rod().axis.elements
    assert replace(Spring(), coils=3.01).rod().axis.elements > Spring().rod().axis.elements
    with pytest.raises(InputError, match="the discretisation changes"), choices.repeated(made):
        pass


def test_models_beside_have_the_functions_of_a_layered_section():
    rod = isorod.straight(4.0).sweep(isorod.circle(8, 1.0)).with_rings([0.5, 1.0])
    with choices.kept() as made:
        own = isorod.Space(rod, section_degree=4).basis
    with choices.repeated(made):
        beside = isorod.Space(rod, section_degree=4).basis
    points = np.array([[0.6, 0.1], [0.0, -0.9]])
    np.testing.assert_allclose(beside.functions(points)[0], own.functions(points)[0], atol=1e-13)


@pytest.mark.parametrize("radius", ["[10.8, 6.6]", "[8.0, 10.0, 8.0]"], ids=["cone", "barrel"])
def test_springs_that_are_no_cylinders_have_those_by_turns_and_radii(radius, tmp_path):
    """A barrel's widest layers are alike at both ends; a cone's energy, held as it is, bends by its turns."""
    path = tmp_path / "spring.toml"
    path.write_text(f"""
[rod.wire]
curve = {{helix = {{radius = {radius}, pitch = 4.7, turns = 4}}}}
section = {{circle = 0.8}}
law = {{LinearElastic = {{E = 2e5, nu = 0.3}}}}
[support.foot]
end = "start"
[support.head]
end = "end"
displacement = [0.0, 0.0, -0.3]
[analysis.statics]
[measure.work]
energy = "wire"
""")
    scene = files.find(str(path))
    found = of(scene)
    lengths = [one for one in found.by if "radius" in one or one.endswith(("pitch", "circle", "displacement.2"))]
    assert sum(logarithmic(found, "work", one) for one in lengths) == pytest.approx(3.0, abs=1e-6)
    turns, works = "rod.wire.curve.helix.turns", []
    with choices.kept() as made:
        parameters.at(scene, {turns: 4.0}).model()
    for one in (3.9999, 4.0001):
        with choices.repeated(made):
            model = parameters.at(scene, {turns: one}).model()
        works.append(scene.measure(statics.solve(model))["work"])
    assert found.by[turns]["work"] == pytest.approx((works[1] - works[0]) / 2e-4, rel=1e-5)


def test_where_a_tie_parts_there_is_none_and_a_line_says_why():
    scene = files.find(str(Path(files.__file__).parent / "examples" / "weld.toml"))
    found = derivatives.of(
        scene, statics.solve(scene.model()), {"rod.steel.curve.straight": 40.0, "support.top.rotation.2": 0.1}
    )
    assert found.none == {"rod.steel.curve.straight": "surfaces that are tied part, or overlap"}
    # A small turn.
    assert logarithmic(found, "torque", "support.top.rotation.2") == pytest.approx(1.0, abs=1e-5)


def test_many_coils_have_the_derivatives_of_scale():
    """A step in the number of coils turns the end by so much that the tangent of the model itself does not suit."""
    found = of(Spring(coils=6, travel=3.0, section_degree=3))
    lengths = ("coil_radius", "pitch", "wire_radius", "travel")
    assert sum(logarithmic(found, "force", one) for one in lengths) == pytest.approx(2.0, abs=1e-8)
    moved = [
        statics.solve(Spring(coils=6 * (1.0 + s), travel=3.0, section_degree=3).model()).reactions[1, 2]
        for s in (-1e-3, 1e-3)
    ]
    change = (moved[1] - moved[0]) / (2e-3 * found.values["force"])
    assert logarithmic(found, "force", "coils") == pytest.approx(change, rel=1e-3)


def test_a_muscle_at_the_end_of_its_range_has_one_sided_derivatives(tmp_path):
    """Activation acts as the largest stress does, and beyond 1 there is none; stresses scale with the moduli."""
    law = "{Muscle = {E = 30.0, nu = 0.45, sigma_max = 30.0, m1 = 35.0, m2 = 0.5, activation = 1.0}}"
    text = BAR[: BAR.index("[analysis.modal]")].replace("{LinearElastic = {E = 2.0e4, nu = 0.3}}", law)
    top = '[support.top]\nend = "end"\ndisplacement = [0, 0, 0.3]\n'
    asked = '[analysis.statics]\n[measure.force]\nreaction = "top"\ncomponent = "z"\n'
    (tmp_path / "muscle.toml").write_text(text + top + asked)
    found = of(files.find(str(tmp_path / "muscle.toml")))
    own = {
        name: logarithmic(found, "force", f"rod.bar.law.Muscle.{name}")
        for name in ("activation", "sigma_max", "E", "m1")
    }
    assert own["activation"] == pytest.approx(own["sigma_max"], rel=1e-8)
    assert own["E"] + own["sigma_max"] + own["m1"] == pytest.approx(1.0, abs=1e-9)
