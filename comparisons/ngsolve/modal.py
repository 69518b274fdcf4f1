"""Vibration modes with NGSolve: linear elasticity, ``K x = omega^2 M x`` by shift and invert."""

from dataclasses import dataclass
from typing import Any

import ngsolve
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from comparisons.measure.timing import Clock
from comparisons.ngsolve.space import INVERSE, displacements, measure
from isorod.errors import SolveError
from isorod.material import LinearElastic
from meshes.mesh import Array

_TOLERANCE = 1e-10

# Room of the Krylov space beyond the modes: with less it starts anew.
_MORE = 14


@dataclass(frozen=True, eq=False)
class Modes:
    """Vibration modes, ascending.

    Attributes
    ----------
    frequencies, residuals
        ``omega / 2 pi``, and ``|K x - lambda M x| / (|lambda| |M x|)``, shapes ``(modes,)``.
    dofs, iterations
        Number of degrees of freedom, held ones included, and of solves with the stiffness.
    seconds
        ``forms``, ``setup``, ``assembly``, ``solve`` and ``check``: the residuals.
    """

    frequencies: Array
    residuals: Array
    dofs: int
    iterations: int
    seconds: dict[str, float]


def solve(
    mesh: ngsolve.Mesh,
    material: tuple[float, float, float],
    modes: int,
    degree: int,
    family: str,
    rule: int | str,
    refinements: int = 0,
) -> Modes:
    """Return the lowest modes of a linear elastic body whose ``start`` is clamped.

    ARPACK's Lanczos method about NGSolve's factors: of `ngsolve.ArnoldiSolver`, `ngsolve.eigenvalues.LOBPCG` and
    `PINVIT` none is as fast at the tolerance of the other programs.

    Parameters
    ----------
    material
        Young's modulus, Poisson's ratio and density.
    modes
        Number of modes.
    degree, family, rule
        See `comparisons.ngsolve.space`; the mass is integrated to twice the degree.
    refinements
        Corrections of each solve by its residual: with Irons' points NGSolve's Cholesky factors solve to 4e-2 alone, to
        4e-5 with one, UMFPACK's to 4e-10.
    """
    clock = Clock()
    space = displacements(mesh, degree, family, "start")
    body, mass_measure = measure(mesh, rule), measure(mesh, 2 * degree)
    young, poisson, density = material
    law = LinearElastic(young, poisson)
    u, v = space.TnT()
    clock.lap("setup")
    strain, virtual = ngsolve.Sym(ngsolve.Grad(u)), ngsolve.Sym(ngsolve.Grad(v))
    stress = 2.0 * law.mu * strain + law.lame * ngsolve.Trace(strain) * ngsolve.Id(3)
    stiffness = ngsolve.BilinearForm(space, symmetric=True)
    stiffness += ngsolve.InnerProduct(stress, virtual) * body
    component = displacements(mesh, degree, family, "start", components=1)
    mass = ngsolve.BilinearForm(component)
    mass += density * component.TrialFunction() * component.TestFunction() * mass_measure
    clock.lap("forms")
    stiffness.Assemble()
    mass.Assemble()
    clock.lap("assembly")
    nodes = space.FreeDofs()
    factors = stiffness.mat.Inverse(nodes, inverse=INVERSE)
    free = np.repeat(np.array(list(nodes), dtype=bool), 3)
    inertia = _Mass(mass.mat, free)
    applied = _Operator(stiffness.mat, free)
    solver = _Inverse(_Operator(factors, free), applied, refinements)
    inverted, weight = (LinearOperator((free.size, free.size), it, dtype=float) for it in (solver, inertia))
    start = np.where(free, np.random.default_rng(0).standard_normal(free.size), 0.0)
    try:
        values, vectors = eigsh(
            weight, modes, weight, sigma=0.0, OPinv=inverted, v0=start, ncv=modes + _MORE, tol=_TOLERANCE
        )
    except ArpackError as problem:
        raise SolveError(f"modes: ARPACK: {problem}") from None
    clock.lap("solve")
    residuals = _residuals(applied, inertia, values, vectors)
    clock.lap("check")
    frequencies = np.sqrt(values) / (2.0 * np.pi)
    return Modes(frequencies, residuals, free.size, solver.count, clock.seconds)


class _Operator:
    """A matrix of NGSolve on arrays; held unknowns stay zero."""

    def __init__(self, matrix: Any, free: Array) -> None:
        self.matrix, self.free = matrix, free
        self.input, self.output = matrix.CreateColVector(), matrix.CreateColVector()

    def __call__(self, x: Array) -> Array:
        self.input.FV().NumPy()[:] = x.ravel()
        self.output.data = self.matrix * self.input
        return np.where(self.free, self.output.FV().NumPy(), 0.0)


class _Mass:
    """The mass, the same for each component, as `comparisons.fem.modal` has it."""

    def __init__(self, matrix: Any, free: Array) -> None:
        values, columns, starts = (np.asarray(one) for one in matrix.CSR())
        self.matrix = csr_matrix((values, columns, starts))
        self.free = free

    def __call__(self, x: Array) -> Array:
        return np.where(self.free, (self.matrix @ x.reshape(-1, 3)).ravel(), 0.0)


class _Inverse:
    """Factors, and their corrections by residuals."""

    def __init__(self, factors: _Operator, matrix: _Operator, refinements: int) -> None:
        self.factors, self.matrix, self.refinements = factors, matrix, refinements
        self.count = 0

    def __call__(self, b: Array) -> Array:
        x = self.factors(b)
        for _ in range(self.refinements):
            x += self.factors(b - self.matrix(x))
        self.count += 1 + self.refinements
        return x


def _residuals(stiffness: _Operator, mass: _Mass, values: Array, vectors: Array) -> Array:
    residuals = []
    for value, vector in zip(values, vectors.T, strict=True):
        inertia = value * mass(vector)
        residuals.append(np.linalg.norm(stiffness(vector) - inertia) / np.linalg.norm(inertia))
    return np.array(residuals)
