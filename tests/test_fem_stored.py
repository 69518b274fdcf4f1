"""Stored energies from SymPy in UFL: invariants, fibres, principal stretches where these meet, and what UFL has not."""

import numpy as np
import pytest
import sympy as sp

pytest.importorskip("dolfinx")

import dolfinx.mesh
import ufl
from mpi4py import MPI

from isorod.errors import InputError
from isorod.fenics import compat
from isorod.fenics.flags import FAST
from isorod.fenics.stored import density, energy_of
from isorod.material import LinearElastic, NeoHookean
from isorod.material.muscle import Muscle
from isorod.material.st_venant_kirchhoff import StVenantKirchhoff
from isorod.material.symbols import I1, I2, I8, C, F, I4a, I4b, J, a, activation, b, stretches

POINT, CELL = np.array([[0.5, 0.5, 0.5]]), np.array([0], dtype=np.int32)
# The direction of second derivatives.
WAY = ufl.as_vector([1.0, 0.3, -0.5, 0.2, 0.9, 0.4, -0.7, 0.6, -1.1])
A, B = np.array([0.36, 0.48, 0.8]), np.array([0.6, -0.8, 0.0])


class Sample:
    """One cell with a deformation gradient that can be set, and fibres ``A`` and ``B``."""

    def __init__(self):
        self.mesh = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1, dolfinx.mesh.CellType.hexahedron)
        self.whole = dolfinx.fem.Function(
            compat.function_space(self.mesh, compat.element(self.mesh, "DQ", 0, 9)),
        )
        self.F = ufl.variable(ufl.as_matrix([[self.whole[3 * i + j] for j in range(3)] for i in range(3)]))
        self.fibres = ufl.as_vector(A.tolist()), ufl.as_vector(B.tolist())

    def values(self, stored, order=0):
        """Return a function of ``F``: an energy in UFL, its stress, or its second derivative along ``WAY``."""
        if order == 1:
            stress = ufl.diff(stored, self.F)
            parts = [stress[i, j] for i in range(3) for j in range(3)]
        else:
            for _ in range(order):
                stored = ufl.derivative(stored, self.whole, WAY)
            parts = [stored]
        # Two components at least: UFL has no vectors of one.
        evaluate = compat.expression(ufl.as_vector([*parts, parts[0]]), POINT, FAST)

        def at(given):
            self.whole.x.array[:] = given.ravel()
            return evaluate(self.mesh, CELL).ravel()[:-1]

        return at


@pytest.fixture(scope="module")
def sample():
    return Sample()


def rotation(seed):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


def test_every_symbol_and_function_has_its_value(sample):
    given = np.eye(3) + 0.2 * np.random.default_rng(3).normal(size=(3, 3))
    stretching = given.T @ given
    c, n = sp.symbols("c n")
    cases = {
        I1: np.trace(stretching),
        I2: 0.5 * (np.trace(stretching) ** 2 - np.trace(stretching @ stretching)),
        J: np.linalg.det(given),
        I4a: A @ stretching @ A,
        I4b: B @ stretching @ B,
        I8: A @ stretching @ B,
        F[0, 2] * a[1] + C[1, 2] * b[0]: given[0, 2] * A[1] + stretching[1, 2] * B[0],
        c * I1**n + sp.pi * J ** sp.Rational(-2, 3): 2.0 * np.trace(stretching) ** 1.5
        + np.pi * np.linalg.det(given) ** (-2.0 / 3.0),
        sp.Max(I1, 9, J) + sp.Min(I1, J) - sp.Abs(-J): 9.0,
        sp.Piecewise((I1, I1 > 100), (I2, sp.And(J > 50, I1 > 0)), (sp.sqrt(J), True)): np.sqrt(np.linalg.det(given)),
        sp.log(J) + sp.exp(sp.tanh(0 * J)) + sp.erf(J) * 0: np.log(np.linalg.det(given)) + 1.0,
        activation * J: 0.25 * np.linalg.det(given),
    }
    values = {c: 2.0, n: 1.5, activation: 0.25}
    found = ufl.as_vector([density(one, sample.F, values, sample.fibres) for one in cases])
    evaluate = compat.expression(found, POINT, FAST)
    sample.whole.x.array[:] = given.ravel()
    assert evaluate(sample.mesh, CELL).ravel() == pytest.approx(np.array(list(cases.values())), rel=1e-13)


STATES = {
    "rest": np.eye(3),
    "swollen": 1.3 * np.eye(3),
    "turned": rotation(1),
    "two alike": rotation(1) @ np.diag([1.2, 1.2, 0.7]) @ rotation(2),
    "two nearly alike": rotation(1) @ np.diag([1.2, 1.2 + 1e-5, 0.7]) @ rotation(2),
    "nearly at rest": np.eye(3) + 1e-8 * rotation(1),
    "three": np.diag([1.3, 1.0, 0.8]),
}


@pytest.mark.parametrize("order", [0, 1, 2])
def test_stretches_are_exact_where_they_meet(sample, order):
    """Sums of powers of the stretches, 4 and -2, against the same by invariants."""
    one, two, three = stretches
    by_stretches = sum(one**4 + one**-2 for one in (one, two, three))
    by_invariants = I1**2 - 2 * I2 + I2 / J**2
    found, exact = (sample.values(density(it, sample.F), order) for it in (by_stretches, by_invariants))
    for given in STATES.values():
        wanted = exact(given)
        assert np.abs(wanted).max() > 1.0
        assert found(given) == pytest.approx(wanted, abs=1e-7 * np.abs(wanted).max())


LAWS = {
    "linear": LinearElastic(200.0, 0.3),
    "neo-Hookean": NeoHookean(200.0, 0.3),
    "St. Venant": StVenantKirchhoff(200.0, 0.3),
    "muscle": Muscle(30.0, 0.4, 20.0, 5.0, 2.0, 0.7, A),
    "active": Muscle(30.0, 0.4, 20.0, 0.0, 2.0, 0.7, A),
}


@pytest.mark.parametrize("name", LAWS)
def test_laws_store_what_they_say(sample, name):
    law = LAWS[name]
    energy, stress = (sample.values(energy_of(law, 1.0, sample.fibres)(sample.F), order) for order in (0, 1))
    for scale in (0.45, 0.8, 1.0, 1.2, 1.7):
        given = scale * np.eye(3) + 0.05 * np.random.default_rng(4).normal(size=(3, 3))
        assert energy(given) == pytest.approx(law.energy(given), rel=1e-12)
        assert stress(given) == pytest.approx(law.stress(given).ravel(), rel=1e-10, abs=1e-10)


@pytest.mark.parametrize(
    "expression, message",
    [
        (sp.gamma(J), "UFL has no function gamma"),
        (sp.Symbol("k") * J, "the symbol k has no value"),
        (I4b, "it has fibres b, and no direction of these is given"),
        (sp.Piecewise((I1, J > 1)), "a Piecewise has no default"),
        (sp.Piecewise((I1, sp.Xor(J > 1, I1 > 3)), (J, True)), "UFL has no condition Xor"),
    ],
)
def test_what_cannot_be_told_is_refused(sample, expression, message):
    with pytest.raises(InputError, match=message):
        density(expression, sample.F, {}, sample.fibres[:1])


def test_an_incompressible_law_is_refused():
    with pytest.raises(InputError, match="incompressible"):
        energy_of(NeoHookean(1.0, 0.5))
