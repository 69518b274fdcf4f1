"""Fields of both sides at the same points of the rods, given by parameters, and how far they are apart."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from comparisons.measure import timing
from comparisons.measure.records import Record
from isorod.arrays import Array, Index
from meshes import within
from meshes.mesh import gauss

# Parameters that differ by less are the same point.
_SAME = 1e-6

# The points of a brick where its stresses are.
GAUSS, _ = gauss("hexahedron", 3)

# Points that are evaluated at a time.
_AT_ONCE = 5_000

# Modes whose frequencies differ by a smaller fraction are not distinguished by either side's shapes alone.
CLOSE = 0.02


@dataclass(frozen=True, eq=False)
class Places:
    """Points of rods: where displacements or mode shapes are compared, and where stresses are.

    Attributes
    ----------
    rod, xi, u
        Of each point, the number of its rod ``(n,)`` and its parameters ``(n, 2)``, ``(n,)``; of points of bodies -1
        for the first of them, -2 for the next, and where it is, ``xi`` and ``u`` one behind the other.
    stress_rod, stress_xi, stress_u
        The same of the points of surfaces where stresses are compared (`isorod.checks.stresses`); none in modes.
    """

    rod: Index
    xi: Array
    u: Array
    stress_rod: Index
    stress_xi: Array
    stress_u: Array

    @classmethod
    def read(cls, path: Path) -> "Places":
        """Return the places of a file of `write`."""
        with np.load(path) as arrays:
            return cls(**{name: arrays[name] for name in cls.__dataclass_fields__})

    def write(self, path: Path) -> None:
        """Write the points to an ``.npz`` file."""
        np.savez(path, **{name: getattr(self, name) for name in self.__dataclass_fields__})


@dataclass(frozen=True, eq=False)
class Sample:
    """Fields of finite elements: on their nodes, and stresses at points of each cell.

    Attributes
    ----------
    places
        Those points.
    weights
        The nodes' fractions of the volume ``(n,)``.
    points, cells, order
        The mesh, as in `meshes.mesh.Mesh`.
    displacement
        ``(n, 3)``; None of modes.
    von_mises
        Stresses as pictures show them: at 2 x 2 x 2 Gauss points of bricks ``(8 cells,)``, at the nodes of tetrahedra
        ``(10 cells,)``; None of modes.
    surface_von_mises
        Stresses at the places for these ``(m,)``; None of modes.
    modes, frequencies
        Shapes ``(modes, n, 3)`` and frequencies of flexible modes; None in statics.
    reference
        Of tetrahedra, whose finer meshes do not have the nodes of coarser ones, the nodes of the reference cell; None
        of bricks.
    """

    places: Places
    weights: Array
    points: Array
    cells: Index
    order: int
    displacement: Array | None = None
    von_mises: Array | None = None
    surface_von_mises: Array | None = None
    modes: Array | None = None
    frequencies: Array | None = None
    reference: Array | None = None

    def on(self, points: Array) -> dict[str, Array]:
        """Return ``displacement`` or ``modes`` at other points ``(m, 3)``, of tetrahedra."""
        assert self.reference is not None
        cells, where = within.Places("tetrahedron", self.order, self.reference, self.points[self.cells]).find(points)
        values, nodes = within.lagrange(self.order, self.reference, where), self.cells[cells]
        if self.modes is not None:
            return {"modes": np.einsum("mn,kmna->kma", values, self.modes[:, nodes])}
        assert self.displacement is not None
        return {"displacement": np.einsum("mn,mna->ma", values, self.displacement[nodes])}

    @classmethod
    def read(cls, path: Path, rigid: int = 0) -> "Sample":
        """Return what ``python -m comparisons.fem rods ... --fields`` wrote, without the ``rigid`` modes."""
        with np.load(path) as arrays:
            given = dict(arrays)
        stress = given.get("surface_parameters", np.zeros((0, 3)))
        places = Places(
            given["node_rod"],
            given["parameters"][:, :2],
            given["parameters"][:, 2],
            given.get("surface_rod", np.zeros(0, dtype=np.int64)),
            stress[:, :2],
            stress[:, 2],
        )
        for name in {"modes", "frequencies"} & given.keys():
            given[name] = given[name][rigid:]
        own = {name: given[name] for name in cls.__dataclass_fields__ if name in given}
        return cls(places, **own | {"order": int(own["order"])})

    def fields(self, rows: Any) -> dict[str, Array]:
        """Return ``displacement`` or ``modes`` at some of the nodes."""
        if self.modes is not None:
            return {"modes": self.modes[:, rows]}
        assert self.displacement is not None
        return {"displacement": self.displacement[rows]}


def of_finite_elements(scene: str, *words: str) -> tuple[Record, Sample]:
    """Return the record of a scene in dolfinx, and its fields."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "fields.npz"
        record = timing.run("comparisons.fem", ["rods", scene, *words, "--fields", str(file)])
        return record, Sample.read(file, record.get("rigid", 0))


def fields(solution: Any, places: Places) -> dict[str, Array]:
    """Return ``displacement`` ``(n, 3)`` and ``von_mises`` ``(m,)`` of a solution, or ``modes`` ``(modes, n, 3)``.

    Of a motion they are those in the end.
    """
    first = places.rod, places.xi, places.u
    if hasattr(solution, "vectors"):
        return {"modes": np.array([_displaced(solution, one, *first) for one in list(solution)[solution.rigid :]])}
    solution = solution[-1] if hasattr(solution, "times") else solution
    second = places.stress_rod, places.stress_xi, places.stress_u
    return {"displacement": _displaced(solution, solution, *first), "von_mises": _stresses(solution, *second)}


def _displaced(solution: Any, state: Any, rods: Index, xi: Array, u: Array) -> Array:
    """Return the displacement ``(n, 3)`` of a state of a solution's model, at points of rods and bodies."""
    values = np.empty((u.size, 3))
    for rod in np.unique(rods):
        (here,) = np.nonzero(rods == rod)
        if rod < 0:
            functions = solution.model.solids[-1 - rod].rows(np.column_stack([xi[here], u[here]]))
            nodal = np.reshape(state.solids[-1 - rod], (-1, 3))[functions.nodes]
            values[here] = np.einsum("qm,qma->qa", functions.values, nodal)
            continue
        space = solution.model.bodies[rod].space
        nodal = state.fields(int(rod))["displacement"].reshape(space.layers, -1, 3)
        along, across = _within(space, xi[here], u[here])
        for part in np.array_split(np.arange(here.size), 1 + here.size // _AT_ONCE):
            first, axial, _ = space.axis.local(along[part])
            section, _ = space.basis.functions(across[part])
            near = nodal[(first[:, None] + np.arange(axial.shape[1])) % space.layers]
            values[here[part]] = np.einsum("mj,ml,mjla->ma", axial, section, near, optimize=True)
    return values


def _stresses(solution: Any, rods: Index, xi: Array, u: Array) -> Array:
    """Return the von Mises stress at points of rods, in calls for those that have the same ``u``."""
    values = np.empty(u.size)
    for rod in np.unique(rods):
        (here,) = np.nonzero(rods == rod)
        along, across = _within(solution.model.bodies[rod].space, xi[here], u[here])
        order = np.argsort(along, kind="stable")
        for group in np.split(order, np.flatnonzero(np.diff(along[order])) + 1):
            values[here[group]] = solution.stress(int(rod), along[group[:1]], across[group], "von Mises")[0]
    return values


def _within(space: Any, xi: Array, u: Array) -> tuple[Array, Array]:
    """Return axis parameters and disk points that miss an end, or a surface, by rounding exactly there."""
    hole, size = space.rod.rings[0], np.linalg.norm(xi, axis=1)
    radius = np.clip(size, hole, 1.0)
    across = xi * (radius / np.maximum(size, 1e-300))[:, None]
    return np.clip(np.round(u, 10), *space.axis.breaks[[0, -1]]), across


def common(coarse: Places, fine: Places) -> tuple[Index, Index]:
    """Return the numbers of those points of two meshes that are the same."""
    keys = [np.column_stack([10.0 * one.rod, one.xi, one.u]) for one in (coarse, fine)]
    distance, nearest = cKDTree(keys[1]).query(keys[0])
    same = np.flatnonzero(distance < _SAME)
    return same, np.asarray(nearest[same])


def relative(values: Array, reference: Array, weights: Array) -> float:
    """Return ``sqrt(sum w |values - reference|^2 / sum w |reference|^2)`` of fields ``(n,)`` or ``(n, 3)``."""
    size = weights @ _squares(reference)
    return float(np.sqrt(weights @ _squares(values - reference) / size)) if size > 0.0 else 0.0


def _squares(field: Array) -> Array:
    return np.asarray(np.sum(field.reshape(len(field), -1) ** 2, axis=1))


def pairs(ours: Array, theirs: Array, weights: Array, frequencies: Sequence[Array]) -> tuple[Index, Array]:
    """Return for each mode of theirs which of ours has its shape, and the part of its shape that ours do not have.

    Where several frequencies lie together, shapes are any of those that they span: of each shape of theirs it is what
    is left after the best combination of ours with frequencies within 2 %.

    Parameters
    ----------
    ours, theirs
        Shapes ``(modes, n, 3)`` at the same points.
    weights
        The points' fractions of the volume ``(n,)``.
    frequencies
        Of ours and of theirs, ascending.
    """
    from scipy.optimize import linear_sum_assignment

    from comparisons.measure import mac

    root = np.sqrt(weights)[:, None]
    first, second = ours * root, theirs * root
    apart = np.abs(frequencies[0][:, None] / frequencies[1] - 1.0)
    # Shapes decide among near frequencies, frequencies among shapes that do not distinguish.
    cost = np.where(apart < 10.0 * CLOSE, -mac.matrix(first, second), 1.0) + 1e-3 * apart
    rows, columns = linear_sum_assignment(cost)
    partner = np.full(len(theirs), -1, dtype=np.int64)
    partner[columns] = rows
    # Where they have more modes than ours.
    partner = np.where(partner < 0, min(len(ours), len(theirs)) - 1, partner)
    left = np.empty(len(theirs))
    for k, shape in enumerate(second):
        near = np.flatnonzero(apart[:, k] < max(CLOSE, 1.5 * apart[partner[k], k]))
        rest = shape - np.tensordot(combination(first[near], shape), first[near], 1)
        left[k] = np.linalg.norm(rest) / np.linalg.norm(shape)
    return partner, left


def combination(shapes: Array, target: Array) -> Array:
    """Return the factors of shapes ``(modes, n, 3)`` whose sum is nearest to one ``(n, 3)``."""
    return np.asarray(np.linalg.lstsq(shapes.reshape(len(shapes), -1).T, target.ravel(), rcond=1e-12)[0])
