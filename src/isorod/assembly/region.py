"""Elements, and points of their sections, with one law: forces and tangents, some elements at a time."""

from collections.abc import Iterator
from functools import cache, cached_property
from typing import Any

import numpy as np

from isorod.arrays import Array, Index
from isorod.assembly import block_kernel
from isorod.assembly.block_kernel import Steps
from isorod.assembly.extrapolation import Last
from isorod.assembly.field_kernel import Field, Functions, add_resultants, determinants, stresses
from isorod.assembly.gradients import coefficients
from isorod.assembly.pattern_kernel import Blocks
from isorod.assembly.stiffness_kernel import add_blocks, moduli, multiply
from isorod.material.along_rod import Laws, Piece
from isorod.material.law import Material
from isorod.material.points import STEP, address
from isorod.space.space import Table

NONE = np.empty((0, 0))

# Points whose stresses are evaluated at a time, and numbers in moduli and section matrices together: few enough for the
# processor's cache, and enough for few calls from Python.  Measured: twice or half as many are no better.
_POINTS = 4096
_NUMBERS = 200_000

# Fewest places along the axis at a time: BLAS is slow at products with fewer rows.
_PLACES = 48

# Most numbers in products of section functions; with more, the section's points are taken in several passes.
_PRODUCTS = 8_000_000

# Relative difference of geometry between places that counts as none.
_SAME = 1e-12


class Region:
    """Elements ``first .. last - 1`` of a part, and points of their sections, with one law.

    Parameters
    ----------
    table
        Functions and geometry of the part.
    segment
        The elements, the points and the law.

    Attributes
    ----------
    table
        Functions and geometry of these elements and points.
    """

    def __init__(self, table: Table, segment: Piece) -> None:
        self.segment, self.first, self.last = segment, segment.first, segment.last
        self.table = table.part(slice(segment.first, segment.last), segment.points)

    @property
    def shape(self) -> tuple[int, ...]:
        """Elements, places along each and points in the section."""
        return self.table.weights.shape

    def own(self, values: Any) -> Any:
        """Return the rows of arrays ``(E, ...)`` of the part's elements for these elements."""
        return values[self.first : self.last]

    def at_points(self, values: Array) -> Array:
        """Return values ``(E t, q)`` at these points from arrays ``(E, t, q)`` of the part; empty ones unchanged."""
        return _rows(self.own(values)[:, :, self.segment.points, None]) if values.size else values

    @cached_property
    def _known(self) -> Array:
        """Data at the points that are constant in a step (`isorod.assembly.field_kernel.take_known`)."""
        table, law = self.table, self.segment.law
        known = [table.inverse.reshape(*self.shape, 9), table.weights[..., None]]
        return _rows(np.concatenate([*known, law.known(self.shape)] if law.width else known, axis=-1))

    def obey(self, law: Material) -> None:
        """Set the law to another state."""
        self.segment = self.segment._replace(law=law)
        self.__dict__.pop("_known", None)

    def _of(self, values: Array, first: int, last: int) -> Array:
        """Return the rows of some elements from those of all, equally many for each."""
        each = values.shape[0] // self.shape[0]
        return values[first * each : last * each]

    @cached_property
    def _section(self) -> tuple[Array, Array]:
        """Derivatives of the section functions, first by one direction, ``(n, 2 q)``, and these ``(n, q)``."""
        across = np.ascontiguousarray(self.table.section[:, :2].transpose(2, 1, 0)).reshape(-1, 2 * self.shape[2])
        return across, np.ascontiguousarray(self.table.section[:, 2].T)

    @cached_property
    def _volumes(self) -> Array | None:
        """Weights of places along the axis over the first's, ``(E t,)``, if moduli differ by these alone; else None.

        They do in straight rods of one section with a law that depends on neither state nor place.
        """
        law, inverse, weights = self.segment.law, self.table.inverse, self.table.weights
        if law.objective or law.width or np.abs(inverse - inverse[0, 0]).max() > _SAME * np.abs(inverse).max():
            return None
        volumes = weights.sum(axis=2) / weights[0, 0].sum()
        same = np.abs(weights - volumes[:, :, None] * weights[0, 0]).max() <= _SAME * weights.max()
        return volumes.ravel() if same else None

    def _law(
        self, factor: float, pressed: bool, with_moduli: bool = False, extrapolates: bool = False
    ) -> tuple[Functions, Steps]:
        """Return law and steps for the compiled loops: with moduli or stress alone, with extrapolated stress or not."""
        law = self.segment.law.reached(factor)
        one = law.compiled
        trace = not law.logarithmic
        functions = Functions(one.block, one.tangent if with_moduli else 0, law.constants)
        return functions, _steps(with_moduli, extrapolates, pressed, trace)

    def _some(self, count: int) -> Iterator[tuple[int, int]]:
        """Yield the bounds of ``count`` elements at a time, at least one."""
        elements, step = self.shape[0], max(1, count)
        for first in range(0, elements, step):
            yield first, min(first + step, elements)

    def _coefficients(self, local: Array, starts: Index) -> tuple[Array, Array]:
        """Return the section coefficients of displacements at all places (`isorod.assembly.gradients.coefficients`)."""
        n = self.table.section.shape[2]
        nodal = local[starts[:, :, None] + np.arange(3 * n)].reshape(*starts.shape, n, 3)
        return coefficients(self.table.axial, self.table.slopes, nodal)

    def _field(self, moves: tuple[Array, Array], pressures: Array, first: int, last: int) -> Field:
        """Return gradients of displacements on disk x axis, and pressures, at the points of some elements."""
        across, whole = self._section
        values, slopes, pressures = (self._of(one, first, last) for one in (*moves, pressures))
        return Field((values @ across).reshape(-1, self.shape[2]), slopes @ whole, pressures)

    def add_forces(
        self,
        local: Array,
        starts: Index,
        factor: float,
        forces: Array,
        pressure: Array = NONE,
        with_energy: bool = False,
    ) -> float:
        """Add the internal forces.

        Parameters
        ----------
        local, starts
            Degrees of freedom, and where those of the layers of the part's elements begin, shape ``(E, l)``.
        factor
            The load factor.
        forces
            On the same degrees of freedom; an empty array if only the energy is needed.
        pressure
            That of the mixed formulation at the part's points ``(E, t, q)``, or an empty array.

        Returns
        -------
        energy
            That of the law, with ``with_energy``.
        """
        _, along, points = self.shape
        law = self._law(factor, pressure.size > 0)
        pressures, starts = self.at_points(pressure), self.own(starts)
        across, whole = self._section
        energy, moves = 0.0, self._coefficients(local, starts)
        for first, last in self._some(_POINTS // (along * points)):
            field = self._field(moves, pressures, first, last)
            energy += stresses(*law, self._of(self._known, first, last), field, with_energy)
            if forces.size:
                sums = field.across.reshape(-1, 2 * points) @ across.T, field.along @ whole.T
                add_resultants(self.table, *sums, first, last, starts, forces)
        return energy

    def set_jacobians(self, local: Array, starts: Index, out: Array) -> None:
        """Fill in ``det F`` at these points in an array ``(E, t, q)`` of the part."""
        _, along, points = self.shape
        deform, moves = _deform(), self._coefficients(local, self.own(starts))
        result = np.empty((self.shape[0] * along, points))
        for first, last in self._some(_POINTS // (along * points)):
            field = self._field(moves, NONE, first, last)
            determinants(deform, self._of(self._known, first, last), field, self._of(result, first, last))
        self.own(out)[:, :, self.segment.points] = result.reshape(self.shape)

    def add_stiffness(
        self,
        local: Array,
        starts: Index,
        factor: float,
        blocks: Blocks,
        entries: Array,
        pressure: Array = NONE,
        last: Last | None = None,
    ) -> None:
        """Add the tangents of the part's elements to entries.

        Parameters
        ----------
        local, starts, factor, pressure
            As in `add_forces`.
        blocks, entries
            Positions of the part's element blocks in these entries.
        last
            State from which the stress is extrapolated, or None.
        """
        elements, along, points = self.shape
        law = self._law(factor, pressure.size > 0, True, last is not None)
        before = NONE if last is None else self.at_points(last.pressure)
        pressures, starts = self.at_points(pressure), self.own(starts)
        there = Blocks(self.own(blocks.start), self.own(blocks.width), blocks.total)
        squared = self.table.section.shape[2] ** 2
        tile = min(points, max(16, _PRODUCTS // (10 * squared)))
        count = min(elements, max(-(-_PLACES // along), _NUMBERS // ((45 * tile + 21 * squared) * along)))
        volumes, moves = self._volumes, self._coefficients(local, starts)
        past = None if last is None else self._coefficients(last.local, starts)
        # Allocated once: fresh memory from the system is slow.
        pulled = _Four((3, 4), (3, 3), (9, 2), (6, 1), size=count * along * tile)
        products = _Four((4, 1), (3, 1), (2, 1), (1, 1), size=tile * squared)
        sums, more = (_Four((3, 1), (3, 1), (9, 1), (6, 1), size=count * along * squared) for _ in range(2))
        for k, some in enumerate(self._some(count) if volumes is None else [(0, 1)]):
            places = (some[1] - some[0]) * along
            now = self._field(moves, pressures, *some)
            old = now if past is None else self._field(past, before, *some)
            known = self._of(self._known, *some)
            for begin in range(0, points, tile):
                end = min(begin + tile, points)
                left, right = pulled.of(places, end - begin), products.of(end - begin, squared)
                moduli(*law, known, now, old, (begin, end), pulled.room)
                if k == 0 or tile < points:
                    multiply(self.table, begin, end, right)
                for into, one, other in zip((more if begin else sums).of(places, squared), left, right, strict=True):
                    np.matmul(one, other, out=into)
                if begin:
                    for total, one in zip(sums.of(places, squared), more.of(places, squared), strict=True):
                        total += one
            rows = tuple(one.reshape(places, -1) for one in sums.of(places, squared))
            if volumes is None:
                add_blocks(self.table, *some, rows, there, entries)
                continue
            for first, end in self._some(count):
                many = tuple(volumes[first * along : end * along, None] * one[0] for one in rows)
                add_blocks(self.table, first, end, many, there, entries)


def _rows(values: Array) -> Array:
    """Return values ``(E, t, q, m)`` at points as rows ``(E t m, q)``, place by place."""
    return np.ascontiguousarray(values.swapaxes(2, 3)).reshape(-1, values.shape[2])


class _Four:
    """Work space for four contiguous matrices, whose rows and columns are multiples of two sizes."""

    def __init__(self, *times: tuple[int, int], size: int) -> None:
        self._times = times
        self.room = np.empty(sum(rows * columns for rows, columns in times) * size)
        self._matrices: dict[tuple[int, int], tuple[Array, ...]] = {}

    def of(self, rows: int, columns: int) -> tuple[Array, ...]:
        """Return the matrices for these numbers of rows and columns."""
        if (rows, columns) not in self._matrices:
            matrices, begin = [], 0
            for p, q in self._times:
                end = begin + p * rows * q * columns
                matrices.append(self.room[begin:end].reshape(p * rows, q * columns))
                begin = end
            self._matrices[rows, columns] = tuple(matrices)
        return self._matrices[rows, columns]


@cache
def _deform() -> int:
    return address(block_kernel.deform, STEP)


@cache
def _steps(moduli: bool, extrapolates: bool, pressed: bool, trace: bool) -> Steps:
    """Return the steps of evaluating stresses, or moduli too.

    Parameters
    ----------
    moduli, extrapolates
        Whether moduli are evaluated, and with stress extrapolated from another state.
    pressed, trace
        Whether the formulation is mixed, and whether its ``theta`` is the trace of the strain.
    """

    def maybe(needed: bool, function: Any) -> int:
        return address(function, STEP) if needed else 0

    return Steps(
        _deform(),
        maybe(pressed, block_kernel.press_trace if trace else block_kernel.press),
        maybe(pressed and moduli and not trace, block_kernel.press_moduli),
        maybe(extrapolates, block_kernel.foresee),
        maybe(extrapolates and pressed, block_kernel.press_on),
        maybe(extrapolates, block_kernel.exceed),
        address(block_kernel.pull_back_moduli if moduli else block_kernel.pull_back_stress, STEP),
    )


def regions(table: Table, laws: Laws) -> list[Region]:
    """Return the regions of a table's elements, one for each segment of the laws."""
    return [Region(table, segment) for segment in laws.pieces]
