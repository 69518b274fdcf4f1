"""Frames of thin bars by straight two-node beams: what random scenes of slender rods are held against.

Bars stretch, bend, shear and twist (Timoshenko's beam with its exact stiffness, Przemieniecki 1968, ch. 5 and 11); all
is linear about rest.  Supports are rows of linear equations, so that what holds a frame need not follow axes.
"""

import itertools
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, eigs, splu

Array = Any


@dataclass(frozen=True)
class Bar:
    """Stiffnesses of a section: ``EA``, ``GA`` (of shear), ``EI`` about its x and y, ``GJ``; mass and polar inertia."""

    EA: float
    GA: float
    EI: tuple[float, float]
    GJ: float
    mass: float = 0.0
    polar: float = 0.0


def _stiffness(bar: Bar, length: float) -> Array:
    k = np.zeros((12, 12))
    for value, one, other in ((bar.EA, 2, 8), (bar.GJ, 5, 11)):
        k[np.ix_([one, other], [one, other])] += value / length * np.array([[1, -1], [-1, 1]])
    for move, turn, sign, stiff in ((0, 4, 1.0, bar.EI[1]), (1, 3, -1.0, bar.EI[0])):
        phi = 12.0 * stiff / (bar.GA * length**2)
        a, b = 12.0, 6.0 * length * sign
        c, d = (4.0 + phi) * length**2, (2.0 - phi) * length**2
        at = [move, turn, move + 6, turn + 6]
        k[np.ix_(at, at)] += (
            stiff / (length**3 * (1.0 + phi)) * np.array([[a, b, -a, b], [b, c, -b, d], [-a, -b, a, -b], [b, d, -b, c]])
        )
    return k


def _tensioned(length: float) -> Array:
    """Return what a unit of tension adds to the stiffness."""
    k = np.zeros((12, 12))
    for move, turn, sign in ((0, 4, 1.0), (1, 3, -1.0)):
        b, c = 3.0 * length * sign, length**2
        at = [move, turn, move + 6, turn + 6]
        k[np.ix_(at, at)] += np.array([[36, b, -36, b], [b, 4 * c, -b, -c], [-36, -b, 36, -b], [b, -c, -b, 4 * c]]) / (
            30.0 * length
        )
    return k


def _mass(bar: Bar, length: float) -> Array:
    m = np.zeros((12, 12))
    for value, one, other in ((bar.mass, 2, 8), (bar.polar, 5, 11)):
        m[np.ix_([one, other], [one, other])] += value * length / 6.0 * np.array([[2, 1], [1, 2]])
    for move, turn, sign in ((0, 4, 1.0), (1, 3, -1.0)):
        at, s = [move, turn, move + 6, turn + 6], sign * length
        m[np.ix_(at, at)] += (bar.mass * length / 420.0) * np.array(
            [
                [156, 22 * s, 54, -13 * s],
                [22 * s, 4 * length**2, 13 * s, -3 * length**2],
                [54, 13 * s, 156, -22 * s],
                [-13 * s, -3 * length**2, -22 * s, 4 * length**2],
            ]
        )
        # Of sections that turn.
        m[[turn, turn + 6], [turn, turn + 6]] += 0.25 * bar.polar * length
    return m


def _blocks(axes: Array) -> Array:
    return np.kron(np.eye(4), axes)


@dataclass
class Frame:
    """Nodes, bars between them, what is held and what pulls; ``solve`` comes first."""

    places: list[Array] = field(default_factory=list)
    bars: list[tuple[int, int, Bar, Array]] = field(default_factory=list)
    rows: list[tuple[dict[int, float], float]] = field(default_factory=list)
    springs: list[tuple[int, float]] = field(default_factory=list)
    loads: dict[int, float] = field(default_factory=dict)

    def line(self, points: Array, bar: Bar, normal: Array, first: int | None = None) -> list[int]:
        """Add bars along points, from a node that is there if one is given; return the nodes."""
        nodes = [first] if first is not None else []
        for point in points[len(nodes) :]:
            nodes.append(len(self.places))
            self.places.append(point)
        for one, other in itertools.pairwise(nodes):
            along = self.places[other] - self.places[one]
            z = along / np.linalg.norm(along)
            x = normal - (normal @ z) * z
            if np.linalg.norm(x) < 1e-3:
                x = np.eye(3)[np.argmin(np.abs(z))]
                x -= (x @ z) * z
            x /= np.linalg.norm(x)
            self.bars.append((one, other, bar, np.array([x, np.cross(z, x), z])))
        return nodes

    def hold(self, node: int, way: Array, value: float = 0.0, *, turn: bool = False) -> int:
        """Hold a node's motion along a vector, or its rotation about it; return the number of the equation."""
        self.rows.append(({6 * node + 3 * turn + k: float(c) for k, c in enumerate(way) if c}, value))
        return len(self.rows) - 1

    def pull(self, node: int, force: Array, *, turn: bool = False) -> None:
        """Add a force on a node, or a moment."""
        for k, one in enumerate(force):
            at = 6 * node + 3 * turn + k
            self.loads[at] = self.loads.get(at, 0.0) + float(one)

    def _sum(self, of: Any) -> Any:
        rows, columns, values = [], [], []
        for number, (one, other, bar, axes) in enumerate(self.bars):
            length = float(np.linalg.norm(self.places[other] - self.places[one]))
            turned = _blocks(axes)
            at = np.r_[6 * one : 6 * one + 6, 6 * other : 6 * other + 6]
            rows.append(np.repeat(at, 12))
            columns.append(np.tile(at, 12))
            values.append((turned.T @ of(number, bar, length) @ turned).ravel())
        size = 6 * len(self.places)
        return sparse.coo_matrix(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (size, size)
        ).tocsc()

    def _tangent(self, forces: Array | None = None) -> Any:
        """Return the stiffness bordered by what is held."""
        k = self._sum(lambda _, bar, length: _stiffness(bar, length))
        if forces is not None:
            k = k + self._sum(lambda n, _, length: forces[n] * _tensioned(length))
        size = k.shape[0]
        k = k + sparse.coo_matrix(
            ([value for _, value in self.springs], ([at for at, _ in self.springs],) * 2), (size, size)
        )
        held = sparse.lil_matrix((len(self.rows), size))
        scale = float(np.abs(k.diagonal()).mean())
        for number, (row, _) in enumerate(self.rows):
            for at, one in row.items():
                held[number, at] = scale * one
        self._scale = scale
        return sparse.bmat([[k, held.T], [held, None]], format="csc")

    def solve(self) -> "Frame":
        """Find displacements ``(n, 6)``, forces of what is held, and tensions of the bars."""
        size = 6 * len(self.places)
        right = np.zeros(size + len(self.rows))
        for at, one in self.loads.items():
            right[at] = one
        whole = self._tangent()
        right[size:] = [self._scale * value for _, value in self.rows]
        found = splu(whole).solve(right)
        self.moved = found[:size].reshape(-1, 6)
        # The force of the support on the frame.
        self.held = -self._scale * found[size:]
        self.ends = []
        for one, other, bar, axes in self.bars:
            length = float(np.linalg.norm(self.places[other] - self.places[one]))
            own = _blocks(axes) @ self.moved[[one, other]].ravel()
            self.ends.append(_stiffness(bar, length) @ own)
        self.tensions = np.array([one[8] for one in self.ends])
        return self

    def frequencies(self, count: int, *, loaded: bool = False) -> Array:
        """Return the lowest of them, cycles per time, about what `solve` has found or about rest."""
        mass = self._sum(lambda _, bar, length: _mass(bar, length))
        return np.sqrt(self._lowest(self._tangent(self.tensions if loaded else None), mass, count)) / (2.0 * np.pi)

    def factors(self, count: int) -> Array:
        """Return the lowest positive load factors of linear buckling, after `solve`."""
        less = -self._sum(lambda n, _, length: self.tensions[n] * _tensioned(length))
        return self._lowest(self._tangent(), less, count)

    def _lowest(self, whole: Any, other: Any, count: int) -> Array:
        inverse, size = splu(whole), whole.shape[0]
        wide = sparse.block_diag([other, sparse.csc_matrix((size - other.shape[0],) * 2)]).tocsc()
        many = min(4 * count + 8, size - 3)
        values = eigs(
            LinearOperator((size, size), lambda x: inverse.solve(wide @ x), dtype=float),
            many,
            which="LM",
            return_eigenvectors=False,
        )
        real = 1.0 / values[(np.abs(values.imag) < 1e-6 * np.abs(values)) & (values.real > 0.0)].real
        return np.sort(real)[:count]
