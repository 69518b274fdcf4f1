"""The space of shapes in which responses are sought: modes and residual vectors (Ritz vectors)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc
from scipy.linalg import eigh

from isorod.arrays import Array
from isorod.harmonic.damping import Damping

# Relative size below which the remainder of a new shape is dropped: errors of the eigensolver.
_NEW = 1e-7

# Entries of the dense systems that are solved at a time.
_CHUNK = 4_000_000


class Softer:
    """A stiffness that relaxes: ``K`` minus ``fraction(omega)`` times a matrix, as by Prony series of shear moduli."""

    def __init__(self, matrix: PETSc.Mat, prony: Array) -> None:
        self.matrix, self.prony = matrix, prony

    def fraction(self, omega: Array) -> Array:
        """Return the complex fraction of the matrix that is relaxed at angular frequencies ``(n,)``."""
        moduli, times = self.prony.T
        return np.asarray((moduli / (1.0 + 1j * omega[:, None] * times)).sum(axis=1))


class System(NamedTuple):
    """The system: stiffness and mass; damping, Coriolis matrix and stiffnesses that relax, if any."""

    stiffness: PETSc.Mat
    mass: PETSc.Mat
    damping: Damping | None = None
    coriolis: PETSc.Mat | None = None
    softer: Sequence[Softer] = ()


class Basis:
    """Shapes of unit mass in which the stiffness is diagonal, and the response in their coordinates.

    Parameters
    ----------
    system
        The matrices.
    force, by_square
        The excitation, and whether it is multiplied by the square of the frequency.
    ksp, shift
        Solver with the stiffness shifted by ``shift`` times the mass.

    Attributes
    ----------
    vectors
        This rank's entries of the shapes, ``(n, m)``.
    squares
        ``lambda`` of each, shape ``(m,)``.
    """

    def __init__(self, system: System, force: PETSc.Vec, by_square: bool, ksp: PETSc.KSP, shift: float) -> None:
        self._stiffness, self._mass, self._damping, self._coriolis, self._softer = system
        self._force, self.by_square, self._ksp, self._shift = force, by_square, ksp, abs(shift)
        self._comm = force.getComm().tompi4py()
        self.vectors = np.zeros((force.getLocalSize(), 0))
        self.squares = np.zeros(0)

    @property
    def force(self) -> Array:
        """The excitation in coordinates, ``(m,)``."""
        return self._sum(self.vectors.T @ self._force.array_r)

    def grow(self, shapes: Sequence[Array]) -> int:
        """Add shapes, this rank's entries of each; return how many are new."""
        before = self.squares.size
        for shape in shapes:
            vector = shape / self._size(shape)
            for _ in range(2):
                vector = vector - self.vectors @ self._sum(
                    self.vectors.T @ self._times(self._mass, vector[:, None])[:, 0]
                )
            left = self._size(vector)
            if left > _NEW:
                self.vectors = np.column_stack([self.vectors, vector / left])
        images = self._times(self._stiffness, self.vectors)
        small = self._sum(self.vectors.T @ images)
        self.squares, turn = eigh(0.5 * (small + small.T))
        self.vectors = self.vectors @ turn
        self._stiff = images @ turn
        self._heavy = self._times(self._mass, self.vectors)
        matrices = [vector.matrix for vector in self._softer]
        self._soft = [self._times(vector, self.vectors) for vector in matrices]
        self._soft_small = [self._sum(self.vectors.T @ vector) for vector in self._soft]
        if self._coriolis is not None:
            self._turned = self._times(self._coriolis, self.vectors)
            turned = self._sum(self.vectors.T @ self._turned)
            self._turned_small = 0.5 * (turned - turned.T)
        return self.squares.size - before

    def coordinates(self, frequencies: Array) -> Array:
        """Return the response at frequencies, cycles per time, in coordinates of the shapes, complex ``(n, m)``."""
        chunk = max(1, _CHUNK // max(1, self.squares.size) ** 2)
        parts = [self._solve(frequencies[k : k + chunk]) for k in range(0, frequencies.size, chunk)]
        return np.concatenate(parts) if parts else np.zeros((0, self.squares.size), complex)

    def _solve(self, frequencies: Array) -> Array:
        omega = 2.0 * np.pi * frequencies
        diagonal = self.squares - omega[:, None] ** 2 + self._damped(omega)
        force = self.scale(omega)[:, None] * self.force
        if self._coriolis is None and not self._softer:
            return np.asarray(force / diagonal)
        systems = diagonal[:, None] * np.eye(self.squares.size) + 0j
        if self._coriolis is not None:
            systems += 1j * omega[:, None, None] * self._turned_small
        for relaxing, small in zip(self._softer, self._soft_small, strict=True):
            systems -= relaxing.fraction(omega)[:, None, None] * small
        return np.asarray(np.linalg.solve(systems, force[..., None])[..., 0])

    def _damped(self, omega: Array) -> Array:
        if self._damping is None:
            return np.zeros((omega.size, self.squares.size), complex)
        return self._damping.of_modes(omega, self.squares)

    def scale(self, omega: Array) -> Array:
        """Return the factor of the excitation: ``omega^2`` for a prescribed displacement of the base."""
        return omega**2 if self.by_square else np.ones_like(omega)

    def resonances(self) -> tuple[Array, Array]:
        """Return natural frequencies, cycles per time, and the damping ratio of each, shape ``(k,)``."""
        flexible = self.squares > 1e-9 * np.abs(self.squares).max(initial=0.0)
        squares = self.squares[flexible]
        lost = np.zeros(squares.size)
        for _ in range(3 if self._softer else 0):
            omega = np.sqrt(squares)
            fractions = [one.fraction(omega) for one in self._softer]
            terms = [part[:, None, None] * small for part, small in zip(fractions, self._soft_small, strict=True)]
            missing = np.sum(terms, axis=0)
            stiff = np.diag(self.squares) - missing.real
            values, shapes = np.linalg.eigh(stiff)
            numbers = np.flatnonzero(flexible)
            squares = values[np.arange(numbers.size), numbers]
            picked = shapes[np.arange(numbers.size), :, numbers]
            lost = -np.einsum("ki,kij,kj->k", picked, missing.imag, picked) / squares
        ratios = 0.5 * lost + (0.0 if self._damping is None else self._damping.ratios(squares))
        if self._coriolis is not None:
            size = self.squares.size
            rates = np.linalg.eigvals(
                np.block([[np.zeros((size, size)), np.eye(size)], [-np.diag(self.squares), -self._turned_small]])
            )
            whirls = np.sort(rates.imag[rates.imag > 0.0]) ** 2
            kept = whirls > 1e-9 * whirls.max(initial=0.0)
            squared_whirls = whirls[kept]
            return np.sqrt(squared_whirls) / (2.0 * np.pi), self._damping.ratios(
                squared_whirls
            ) if self._damping else np.zeros(squared_whirls.size)
        return np.sqrt(squares) / (2.0 * np.pi), ratios

    def static(self) -> list[Array]:
        """Return the static displacement by the excitation; of a free body, with the shifted stiffness."""
        displacement = self._force.duplicate()
        self._ksp.solve(self._force, displacement)
        return [displacement.array_r.copy()]

    def left(self, frequencies: Array) -> tuple[Array, list[Array]]:
        """Return the relative error of the response at frequencies, and residual vectors, two a frequency.

        Residual vectors are ``K^-1 r`` of the residual forces ``r = f - D x``; the error is ``|K^-1 r| / |x|`` in the
        energy norm.
        """
        errors, shapes = np.zeros(frequencies.size), []
        coordinates = self.coordinates(frequencies)
        force = self._force.array_r
        work, solution = self._force.duplicate(), self._force.duplicate()
        for k, (frequency, x) in enumerate(zip(frequencies, coordinates, strict=True)):
            omega = np.array([2.0 * np.pi * frequency])
            damped = self._damped(omega)[0]
            rest = self.scale(omega)[0] * force - self._stiff @ x + omega[0] ** 2 * (self._heavy @ x) + 0j
            # Structural and stiffness-proportional damping act by the stiffness; the rest, with ratios, by the mass.
            if self._damping is not None:
                stiff = 1j * (self._damping.structural + omega[0] * self._damping.rayleigh[1])
                rest -= stiff * (self._stiff @ x) + self._heavy @ ((damped - stiff * self.squares) * x)
            if self._coriolis is not None:
                rest -= 1j * omega[0] * (self._turned @ x)
            for relaxing, images in zip(self._softer, self._soft, strict=True):
                rest += relaxing.fraction(omega)[0] * (images @ x)
            energy = 0.0
            for part in (rest.real, rest.imag):
                work.array_w[:] = part
                self._ksp.solve(work, solution)
                energy += max(work.dot(solution), 0.0)
                shapes.append(solution.array_r.copy())
            total = float(np.abs(x) ** 2 @ (np.abs(self.squares) + self._shift))
            errors[k] = np.sqrt(energy / total) if total > 0.0 else 0.0
        work.destroy(), solution.destroy()
        return errors, shapes

    def _size(self, shape: Array) -> float:
        return float(np.sqrt(self._sum(np.array(shape @ self._times(self._mass, shape[:, None])[:, 0]))))

    def _times(self, matrix: PETSc.Mat, block: Array) -> Array:
        """Return a matrix times each of several vectors, this rank's entries."""
        x, y = matrix.createVecRight(), matrix.createVecLeft()
        product = np.empty_like(block)
        for k, column in enumerate(block.T):
            x.array_w[:] = column
            matrix.mult(x, y)
            product[:, k] = y.array_r
        x.destroy(), y.destroy()
        return product

    def _sum(self, own: Array) -> Array:
        return np.asarray(self._comm.allreduce(own))
