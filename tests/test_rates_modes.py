"""Derivatives of frequencies: masses of models beside, and modes that have none."""

from dataclasses import replace

import numpy as np
import pytest
from petsc4py import PETSc

from isorod import InputError, choices, files, modal
from isorod.assembly.formulation import assembler_for
from isorod.design import derivatives, parameters
from isorod.scenes.blade import Blade

# A cantilever that a force presses onto a stop.
PROPPED = """
[rod.bar]
curve = {straight = {start = [0.0, 0.0, 0.0], end = [100.0, 0.0, 0.0]}}
section = {circle = 2.0}
law = {NeoHookean = {E = 2.0e5, nu = 0.3}}
density = 7.85e-9

[support.wall]
end = "start"

[load.tip]
end = "end"
force = [0.0, -20.0, 0.0]

[obstacle.stop]
Cylinder = {point = [80.0, -7.0, 0.0], axis = [0, 0, 1], radius = 5.0}

[contact.stop]
first = "bar"
second = "stop"

[analysis.modal]
modes = 3
"""

STOP = "obstacle.stop.Cylinder.point.1"

BLADE = Blade(elements=4, section_degree=3, degree=3)


@pytest.mark.parametrize("lumped", [False, True])
def test_products_by_elements_are_those_of_the_mass_matrix(lumped):
    assembler = assembler_for(BLADE.model(), PETSc.COMM_SELF)
    motions, mass = [assembler.vector() for _ in range(3)], assembler.mass(lumped)
    for seed, one in enumerate(motions):
        one.array = np.random.default_rng(seed).standard_normal(one.getLocalSize())
    whole = [[one.dot(mass * other) for other in motions] for one in motions]
    np.testing.assert_allclose(assembler.mass_products(motions, lumped), whole, rtol=1e-12, atol=1e-12 * np.max(whole))


def test_modes_of_laws_with_a_memory_have_none(monkeypatch):
    solution = modal.solve(BLADE.model(), modes=1)
    monkeypatch.setitem(vars(solution.model), "remembers", True)
    with pytest.raises(InputError, match="not available for modes about a state over time, or of laws with memory"):
        solution.derivatives(lambda values: replace(BLADE, **values).model(), {"E": BLADE.E}, lambda one: {})


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:contact 0", "ignore:compliance of contact")
def test_modes_of_what_touches_have_them_while_the_same_points_do(tmp_path):
    """As frequencies of bars that are solved differ; moduli and forces together change them as the root."""
    (tmp_path / "bar.toml").write_text(PROPPED)
    scene = files.find(str(tmp_path / "bar.toml"))
    with choices.kept() as made:
        model = scene.model()
    solution = modal.solve(model, comm=PETSc.COMM_SELF, **scene.settings())
    modulus, force = "rod.bar.law.NeoHookean.E", "load.tip.force.1"
    found = derivatives.of(scene, solution, {STOP: -7.0, modulus: 2.0e5, force: -20.0})
    assert not found.none
    both = 2.0e5 * found.by[modulus]["frequencies"] - 20.0 * found.by[force]["frequencies"]
    np.testing.assert_allclose(both, 0.5 * solution.frequencies, rtol=1e-5)
    sides = []
    for step in (-1e-3, 1e-3):
        with choices.repeated(made, near=True):
            beside = parameters.at(scene, {STOP: -7.0 * (1.0 + step)}).model()
        sides.append(modal.solve(beside, comm=PETSc.COMM_SELF, **scene.settings()).frequencies)
    rates = -7.0 * found.by[STOP]["frequencies"]
    np.testing.assert_allclose(rates, (sides[1] - sides[0]) / 2e-3, rtol=1e-3, atol=1e-6 * solution.frequencies[0])
    assert abs(rates / solution.frequencies).min() > 1e-5


@pytest.mark.filterwarnings("ignore:contact 0", "ignore:compliance of contact")
def test_modes_have_none_where_points_leave(tmp_path):
    """Elements are too long for the patch, and which points touch changes with next to nothing."""
    coarse = "density = 7.85e-9\nspace = {elements = 10, section_degree = 3, degree = 4}"
    (tmp_path / "bar.toml").write_text(PROPPED.replace("density = 7.85e-9", coarse))
    scene = files.find(str(tmp_path / "bar.toml"))
    solution = modal.solve(scene.model(), comm=PETSc.COMM_SELF, **scene.settings())
    found = derivatives.of(scene, solution, {STOP: -7.0})
    assert set(found.none) == {STOP}
