"""The space of shapes that responses are sought in: modes, and what residuals say is left out (Ritz vectors)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc
from scipy.linalg import eigh

from isorod.arrays import Array
from isorod.harmonic.damping import Damping

# What is left of a new shape is none where it is a smaller share of it: of modes what the eigensolver leaves.
_NEW = 1e-7

# Numbers of dense systems that are solved at a time.
_CHUNK = 4_000_000


class Softer:
    """A stiffness that relaxes: ``K`` less ``share(omega)`` of a matrix, as of shear moduli of viscoelastic laws."""

    def __init__(self, matrix: PETSc.Mat, prony: Array) -> None:
        self.matrix, self.prony = matrix, prony

    def share(self, omega: Array) -> Array:
        """Return which part of the matrix is missing at angular frequencies ``(n,)``, complex."""
        shares, times = self.prony.T
        return np.asarray((shares / (1.0 + 1j * omega[:, None] * times)).sum(axis=1))


class System(NamedTuple):
    """What swings: stiffness, mass, and what is beside them: damping, Coriolis forces, stiffnesses that relax."""

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
        What swings.
    force, by_square
        The excitation, and whether it grows with the square of the frequency.
    ksp, shift
        Solver with the stiffness, shifted by so many times the mass.

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
            one = shape / self._size(shape)
            for _ in range(2):
                one = one - self.vectors @ self._sum(self.vectors.T @ self._times(self._mass, one[:, None])[:, 0])
            left = self._size(one)
            if left > _NEW:
                self.vectors = np.column_stack([self.vectors, one / left])
        images = self._times(self._stiffness, self.vectors)
        small = self._sum(self.vectors.T @ images)
        self.squares, turn = eigh(0.5 * (small + small.T))
        self.vectors = self.vectors @ turn
        self._stiff = images @ turn
        self._heavy = self._times(self._mass, self.vectors)
        matrices = [one.matrix for one in self._softer]
        self._soft = [self._times(one, self.vectors) for one in matrices]
        self._soft_small = [self._sum(self.vectors.T @ one) for one in self._soft]
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
        for one, small in zip(self._softer, self._soft_small, strict=True):
            systems -= one.share(omega)[:, None, None] * small
        return np.asarray(np.linalg.solve(systems, force[..., None])[..., 0])

    def _damped(self, omega: Array) -> Array:
        if self._damping is None:
            return np.zeros((omega.size, self.squares.size), complex)
        return self._damping.of_modes(omega, self.squares)

    def scale(self, omega: Array) -> Array:
        """Return by what the excitation is multiplied: that of a base whose displacement is given grows."""
        return omega**2 if self.by_square else np.ones_like(omega)

    def resonances(self) -> tuple[Array, Array]:
        """Return natural frequencies, cycles per time, and the share of critical damping of each, shape ``(k,)``."""
        flexible = self.squares > 1e-9 * np.abs(self.squares).max(initial=0.0)
        squares = self.squares[flexible]
        lost = np.zeros(squares.size)
        for _ in range(3 if self._softer else 0):
            omega = np.sqrt(squares)
            shares = [one.share(omega) for one in self._softer]
            terms = [part[:, None, None] * small for part, small in zip(shares, self._soft_small, strict=True)]
            missing = np.sum(terms, axis=0)
            stiff = np.diag(self.squares) - missing.real
            values, shapes = np.linalg.eigh(stiff)
            own = np.flatnonzero(flexible)
            squares = values[np.arange(own.size), own]
            picked = shapes[np.arange(own.size), :, own]
            lost = -np.einsum("ki,kij,kj->k", picked, missing.imag, picked) / squares
        ratios = 0.5 * lost + (0.0 if self._damping is None else self._damping.ratios(squares))
        if self._coriolis is not None:
            size = self.squares.size
            rates = np.linalg.eigvals(
                np.block([[np.zeros((size, size)), np.eye(size)], [-np.diag(self.squares), -self._turned_small]])
            )
            whirls = np.sort(rates.imag[rates.imag > 0.0]) ** 2
            kept = whirls > 1e-9 * whirls.max(initial=0.0)
            found = whirls[kept]
            return np.sqrt(found) / (2.0 * np.pi), self._damping.ratios(found) if self._damping else np.zeros(
                found.size
            )
        return np.sqrt(squares) / (2.0 * np.pi), ratios

    def static(self) -> list[Array]:
        """Return what the excitation displaces statically; of a free body, by the shifted stiffness."""
        found = self._force.duplicate()
        self._ksp.solve(self._force, found)
        return [found.array_r.copy()]

    def left(self, frequencies: Array) -> tuple[Array, list[Array]]:
        """Return how far the response at frequencies is off, and the shapes that would mend it, two a frequency.

        Residual forces ``f - D x`` displace by ``K^-1`` what shapes that are left out are missing; the share is that of
        the energy norm, as of strains: ``|K^-1 r| / |x|``.
        """
        shares, shapes = np.zeros(frequencies.size), []
        own = self.coordinates(frequencies)
        force = self._force.array_r
        work, found = self._force.duplicate(), self._force.duplicate()
        for k, (frequency, x) in enumerate(zip(frequencies, own, strict=True)):
            omega = np.array([2.0 * np.pi * frequency])
            damped = self._damped(omega)[0]
            rest = self.scale(omega)[0] * force - self._stiff @ x + omega[0] ** 2 * (self._heavy @ x) + 0j
            # Structural and stiffness-proportional damping are of the stiffness; the rest, and ratios, of the mass.
            if self._damping is not None:
                stiff = 1j * (self._damping.structural + omega[0] * self._damping.rayleigh[1])
                rest -= stiff * (self._stiff @ x) + self._heavy @ ((damped - stiff * self.squares) * x)
            if self._coriolis is not None:
                rest -= 1j * omega[0] * (self._turned @ x)
            for one, images in zip(self._softer, self._soft, strict=True):
                rest += one.share(omega)[0] * (images @ x)
            energy = 0.0
            for part in (rest.real, rest.imag):
                work.array_w[:] = part
                self._ksp.solve(work, found)
                energy += max(work.dot(found), 0.0)
                shapes.append(found.array_r.copy())
            whole = float(np.abs(x) ** 2 @ (np.abs(self.squares) + self._shift))
            shares[k] = np.sqrt(energy / whole) if whole > 0.0 else 0.0
        work.destroy(), found.destroy()
        return shares, shapes

    def _size(self, shape: Array) -> float:
        return float(np.sqrt(self._sum(np.array(shape @ self._times(self._mass, shape[:, None])[:, 0]))))

    def _times(self, matrix: PETSc.Mat, block: Array) -> Array:
        """Return a matrix times each of several vectors, this rank's entries."""
        x, y = matrix.createVecRight(), matrix.createVecLeft()
        found = np.empty_like(block)
        for k, column in enumerate(block.T):
            x.array_w[:] = column
            matrix.mult(x, y)
            found[:, k] = y.array_r
        x.destroy(), y.destroy()
        return found

    def _sum(self, own: Array) -> Array:
        return np.asarray(self._comm.allreduce(own))
