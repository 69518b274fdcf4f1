"""Supports of mean motions in an input file: reference nodes that move as the means do, by ``*EQUATION``.

The means are isorod's own (`isorod.model.mean`), by integrals of the functions of the file's elements over a section,
or round it: linear in the displacements, also where these are large.  RF of the section's nodes is what the support
carries in CalculiX, which prints none of reference nodes; these have U, and in Abaqus RF.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.sparse import csr_array, vstack

from isorod.assembly.averages import Mean
from isorod.errors import InputError
from isorod.geometry.quadrature import ring_of
from isorod.model.mean import MeanSupport
from isorod.model.model import Model
from isorod.model.tie import SolidSurface
from isorod.space.trace import Trace
from meshes import abaqus, deck_pairs, nodal
from meshes.mesh import Array, Index, Mesh

# Coefficients of an equation below this are rounding; a mean that depends on others to this fraction is one of theirs.
_ROUNDING, _DEPENDENT = 1e-12, 1e-9


class _Reference(NamedTuple):
    """A reference node for means of a support: its set, and component and sign of each mean."""

    support: int
    title: str
    place: Array
    components: Index
    signs: Array
    values: Array
    stiffness: Array | None


class Means:
    """The supports of mean motions of a model, on a mesh of its rods.

    Attributes
    ----------
    nodes
        Of the mesh, that take part in each support.
    titles, notes
        The sets of reference nodes, and notes on these, a line each.
    """

    def __init__(self, scene: Any, model: Model, mesh: Mesh) -> None:
        self.model, self.mesh = model, mesh
        self._references: list[_Reference] = []
        self.nodes: dict[int, Index] = {}
        self.notes: list[str] = []
        rows: list[csr_array] = []
        tied = _tied(model, mesh)
        for k, support in model.means.items():
            trace = _trace(mesh, model, support)
            nodes, own = support.rows_on(trace)
            self.nodes[k] = nodes
            if np.isin(nodes, tied).any():
                raise InputError(f"support {k}: a mean motion of what is tied, too, is not written to .inp")
            mean = Mean(nodes, own, support.stiffness)
            rows.append(mean.on_dofs(np.ones(len(own)), mesh.points.size))
            place = trace.weights @ trace.points / trace.weights.sum()
            self._refer(k, support, scene.named(f"support {k}"), place)
        self._rows = vstack(rows, format="csr") if rows else csr_array((0, mesh.points.size))
        self.titles = [one.title for one in self._references]

    def _refer(self, k: int, support: MeanSupport, name: str, place: Array) -> None:
        """Add the reference nodes of a support: of its mean displacement, and of its mean rotation."""
        first = 0
        for title, vectors in ((f"{name} mean", support.directions), (f"{name} rotation", support.axes)):
            if not len(vectors):
                continue
            components = np.abs(vectors).argmax(axis=1)
            if np.abs(vectors).max(axis=1).min() < 1.0 - _DEPENDENT:
                components = np.arange(len(vectors))
                directions = "; ".join(
                    "(" + ", ".join(f"{one:.6g}" for one in np.round(row, 9) + 0.0) + ")" for row in vectors
                )
                self.notes.append(f"{abaqus.name_of(title)}: its components are along {directions}")
                signs = np.ones(len(vectors))
            else:
                signs = np.sign(vectors[np.arange(len(vectors)), components])
            own = slice(first, first + len(vectors))
            stiffness = None if support.stiffness is None else support.stiffness[own]
            named = abaqus.name_of(title)
            self._references.append(_Reference(k, named, place, components, signs, support.values[own], stiffness))
            first += len(vectors)

    def lines(self, number: Index, taken: NDArray[np.bool_], nodes: int, cells: int) -> Iterator[str]:
        """Yield the reference nodes, the equations, and springs.

        Parameters
        ----------
        number
            Of the mesh's nodes in the file.
        taken
            Whether something else prescribes a component of a node, shape ``(nodes, 3)``.
        nodes, cells
            Numbers of nodes and elements that are in the file already.

        Raises
        ------
        InputError
            If supports hold the same twice.
        """
        if not self._references:
            return
        yield "** Mean motions are displacements of nodes of their own"
        terms: list[str] = []
        for k, one in enumerate(self._references, nodes + 1):
            yield f"*NODE,NSET={one.title}"
            yield f"{k}," + ",".join(f"{value:.12g}" for value in one.place)
            terms += [f"{k},{component + 1}" for component in one.components.tolist()]
        signs = np.concatenate([one.signs for one in self._references])
        chosen = self._chosen(taken)
        mixed = np.linalg.inv(self._rows[:, chosen].toarray())
        used = np.unique(self._rows.indices)
        own = mixed @ self._rows[:, used].toarray()
        names = [f"{number[dof // 3]},{dof % 3 + 1}" for dof in used.tolist()]
        for first, row, means in zip(chosen.tolist(), own, -mixed * signs, strict=True):
            values = np.where(used == first, 0.0, row)
            equation = [f"{number[first // 3]},{first % 3 + 1},1."]
            for several, coefficients in ((names, values), (terms, means)):
                kept = np.flatnonzero(np.abs(coefficients) > _ROUNDING).tolist()
                equation += [f"{several[j]},{coefficients[j]:.12g}" for j in kept]
            yield from abaqus.equation(equation)
        for k, reference in enumerate(self._references, nodes + 1):
            if reference.stiffness is None:
                continue
            for component, stiff in zip(reference.components.tolist(), reference.stiffness, strict=True):
                cells += 1
                # A number without a point is a component to CalculiX.
                title = f"{reference.title}_SPRING_{component + 1}"
                yield from [f"*ELEMENT,TYPE=SPRING1,ELSET={title}", f"{cells},{k}"]
                yield from [f"*SPRING,ELSET={title}", f"{component + 1}", f"{stiff:#.12g}"]

    def _chosen(self, taken: NDArray[np.bool_]) -> Index:
        """Return the degrees of freedom of the mesh, one for each mean, that the equations give."""
        free = np.flatnonzero((abs(self._rows).sum(axis=0) > 0.0) & ~taken.ravel())
        own = self._rows[:, free].toarray()
        size = np.abs(own).max(axis=1, initial=0.0, keepdims=True)
        if len(free) >= len(own) and size.min() > 0.0:
            triangle, order = qr(own / size, mode="r", pivoting=True)
            if abs(triangle[len(own) - 1, len(own) - 1]) > _DEPENDENT * abs(triangle[0, 0]):
                return free[order[: len(own)]]
        raise InputError("supports of mean motions hold what another support holds; this is not written to .inp")

    def held(self, factor: float) -> Iterator[str]:
        """Yield prescribed values at a load factor: the means, or the components of nodes on which no spring acts."""
        for reference in self._references:
            fraction = self.model.amplitude(self.model.means[reference.support].clock.table, factor)
            held = dict(
                zip(
                    reference.components.tolist(), (fraction * reference.signs * reference.values).tolist(), strict=True
                )
            )
            if reference.stiffness is not None:
                held = {component: 0.0 for component in range(3) if component not in held}
            yield from (
                f"{reference.title},{component + 1},{component + 1},{value:.12g}" for component, value in held.items()
            )


def _tied(model: Model, mesh: Mesh) -> Index:
    """Return the nodes of rods that ties move."""
    sides = [one for tie in model.ties for one in (tie.slave, tie.master) if not isinstance(one, SolidSurface)]
    faces = [deck_pairs.surface_of(model, mesh, one)[1] for one in sides]
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(face.ravel() for face in faces)]))


def _trace(mesh: Mesh, model: Model, support: MeanSupport) -> Trace:
    """Return the functions of the mesh on the section of a support, or on the line round it."""
    if support.ring:
        nodes, functions, lengths = nodal.on_line(mesh, nodal.edges_at(mesh, support.body, support.u, model))
        weights = np.linalg.norm(lengths, axis=2)
    else:
        nodes, functions, areas = nodal.on_face(mesh, nodal.face_at(mesh, support.body, support.u, model))
        weights = np.linalg.norm(areas, axis=2)
        if support.moduli:
            across = mesh.parameters_in(support.body, nodes)[..., :2]
            middle = np.linalg.norm(across, axis=2).mean(axis=1)
            rings = ring_of(model.bodies[support.body].space.rod.rings, np.stack([middle, 0.0 * middle], axis=1))
            weights = weights * np.array(support.moduli)[rings][:, None]
    used, row = np.unique(nodes, return_inverse=True)
    row = row.reshape(nodes.shape)
    values = np.zeros((*weights.shape, used.size))
    for f in range(len(nodes)):
        values[f][:, row[f]] = functions
    points = np.einsum("qn,fna->fqa", functions, mesh.points[nodes]).reshape(-1, 3)
    flat = values.reshape(len(points), -1)
    return Trace(points, np.zeros_like(points), weights.ravel(), np.tile(used, (len(points), 1)), flat, used)
