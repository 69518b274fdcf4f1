"""Derivatives of frequencies: masses of models beside, and modes that have none."""

from dataclasses import replace

import numpy as np
import pytest
from petsc4py import PETSc

from isorod import InputError, modal
from isorod.assembly.formulation import assembler_for
from isorod.scenes.blade import Blade

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
