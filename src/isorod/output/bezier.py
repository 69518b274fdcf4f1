"""Rods as rational Bezier cells: the very geometry and displacement in a few cells, which VTK and ParaView draw.

Along the axis the cells are its elements, as Bezier extraction gives them (M. J. Borden, M. A. Scott, J. A. Evans &
T. J. R. Hughes, Isogeometric finite element data structures based on Bezier extraction of NURBS, Int. J. Numer. Meth.
Engng 87 (2011) 15-47); across it the patches of `isorod.output.patches`.  Stress is no such function: it is
approximated without going beyond it (`isorod.output.limited`), and elements are cut until that shows it.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from isorod.arrays import Array, Index
from isorod.model.body import Body
from isorod.output import stress
from isorod.output.bernstein import Shape, bernstein, shape_of, triangular
from isorod.output.limited import Limited
from isorod.output.patches import Patches, cover
from isorod.output.vtk import require

if TYPE_CHECKING:
    import pyvista

# Fields that are not of nodes.
_OTHERS = "pressure", "contact_pressure"

# Points at which stress is evaluated at a time.
_CHUNK = 50_000

# Pieces of an element that are tried, until stresses are shown to this share of the largest but for so many places.
_PARTS, _TOLERANCE, _USUAL = (1, 2, 4), 0.02, 0.99

# Patches of the section beyond which Bezier cells are more than linear ones: where they are wanted all the same,
# elements are not cut.
MOST = 64

# Elements that are looked at for that.
_LOOKED = 12

# The six components of a symmetric tensor in VTK's order.
_FIRST, _SECOND = np.array([0, 1, 2, 0, 1, 0]), np.array([0, 1, 2, 1, 2, 2])
_VON_MISES = 6


class Cells:
    """The cells of a body, the same for all states of it.

    Parameters
    ----------
    body
        The body.
    frames
        Fields by name of each state that is to be shown (`grid`); patches are cut so that all of them are met.
    most
        So many patches of the section at the most (`isorod.output.patches.cover`).
    """

    def __init__(self, body: Body, frames: Sequence[Mapping[str, Array]], most: int | None = None) -> None:
        require()
        self.body = body
        space = body.space
        rest = space.positions - space.positions[space.is_carrier].mean(axis=0) * space.is_carrier[:, None]
        columns = [_scaled(rest.reshape(space.layers, -1, 3))]
        for fields in frames:
            columns += [_scaled(nodal.reshape(space.layers, -1, 3)) for nodal in _nodal(fields).values()]
        self.patches: Patches = cover(space, np.concatenate(columns, axis=1), most)
        self._limited = Limited(self.patches, space.axis.degree)
        moved = [fields for fields in frames if "displacement" in fields][-1:]
        tried = _PARTS if len(self.patches.patches) <= MOST else _PARTS[:1]
        for parts in tried:
            self._cut(parts)
            # Of the last to be tried the error changes nothing, and stresses at all samples take long.
            if parts == tried[-1] or all(self._error(fields) <= _TOLERANCE for fields in moved):
                break

    @property
    def breaks(self) -> Array:
        """Axis parameters between which the cells are, shape ``(pieces + 1,)``."""
        return self._axis.breaks

    def _cut(self, parts: int) -> None:
        """Let each element of the rod be so many pieces."""
        axis = self.body.space.axis
        # Of degree one and more, knots of the geometry's own continuity and of the space's are all cut.
        self._axis = axis.refine(parts, axis.degree, 0)
        self._parts = parts
        steps = np.arange(self._axis.elements)[:, None] * axis.degree + np.arange(axis.degree + 1)
        self._steps = steps % self._axis.count
        self._weights = self._axis.weights[self._steps]

    def _error(self, fields: Mapping[str, Array]) -> float:
        """Return how far stresses that the cells show are from the body's, but for one of a hundred places.

        Relative to the largest von Mises stress; of long rods some pieces are looked at.
        """
        largest, gaps = 0.0, []
        count = self._axis.elements
        for some, values in self._values(fields, 1.0, max(1, count // (_LOOKED * self._parts))):
            found = self._limited.controls(values, self._weights[some])
            gaps.append(np.abs(self._limited.shown(found, self._weights[some]) - values).max(axis=3))
            largest = max(largest, float(values[..., _VON_MISES].max()))
        typical = np.quantile(np.concatenate([gap.ravel() for gap in gaps]), _USUAL)
        return float(typical) / largest if largest > 0.0 else 0.0

    def grid(self, fields: Mapping[str, Array], factor: float = 1.0) -> "pyvista.UnstructuredGrid":
        """Return the body at rest as cells with fields at their control points.

        Fields are those of `isorod.output.vtk.grid` but for the pressure of contact: ``cauchy`` (six components, in
        VTK's order) and ``von_mises`` come with ``displacement``, and ``mean_stress`` where there is a ``pressure``.

        Parameters
        ----------
        fields
            Values at the body's nodes by name, shape ``(nodes, 3)``.
        factor
            Load factor of the stress.
        """
        import pyvista

        points = self._points(self.body.space.positions)
        kinds, connectivity, degrees, elements = self._topology
        mesh = pyvista.UnstructuredGrid(connectivity, kinds, points)
        mesh.cell_data["element"] = elements

        mesh.cell_data["HigherOrderDegrees"] = degrees
        mesh.GetCellData().SetActiveAttribute("HigherOrderDegrees", _DEGREES)
        mesh.point_data["RationalWeights"] = (self._weights[:, :, None] * self.patches.weights).ravel()
        mesh.GetPointData().SetActiveAttribute("RationalWeights", _RATIONAL)
        for name, nodal in _nodal(fields).items():
            mesh.point_data[name] = self._points(nodal)
        if "displacement" in fields:
            for name, values in self._stress(fields, factor).items():
                mesh.point_data[name] = values
        return mesh

    def _points(self, nodal: Array) -> Array:
        """Return control points ``(elements (p + 1) m, 3)`` of what has nodal coefficients ``(nodes, 3)``."""
        space = self.body.space
        layers = nodal.reshape(space.layers, -1, 3)[np.arange(space.axis.count) % space.layers]
        along = space.axis.transfer(self._axis, layers)[self._steps]
        across: Array = self.patches.coefficients / self.patches.weights[:, None]
        return (across @ along).reshape(-1, 3)

    def _stress(self, fields: Mapping[str, Array], factor: float) -> dict[str, Array]:
        """Return stresses at the control points."""
        found = np.concatenate(
            [
                self._limited.controls(values, self._weights[some]).reshape(-1, values.shape[-1])
                for some, values in self._values(fields, factor)
            ]
        )
        named = {"cauchy": found[:, :_VON_MISES], "von_mises": found[:, _VON_MISES]}
        return named | ({"mean_stress": found[:, _VON_MISES + 1]} if "pressure" in fields else {})

    def _values(self, fields: Mapping[str, Array], factor: float, step: int = 1) -> Iterator[tuple[slice, Array]]:
        """Yield pieces, every so many, and stresses at their samples along and across: six, von Mises', the mean."""
        lengths, xi, t = np.diff(self.breaks), self.patches.samples, self._limited.samples
        at_once = max(1, _CHUNK // (t.size * len(xi)))
        for first in range(0, lengths.size, step * at_once):
            some = slice(first, min(first + step * at_once, lengths.size), step)
            u = self.breaks[:-1][some, None] + lengths[some, None] * t
            cauchy = stress.cauchy(self.body, fields["displacement"], xi, u.ravel(), factor, fields.get("pressure"))
            six = [cauchy[..., _FIRST, _SECOND], stress.von_mises(cauchy)[..., None]]
            if "pressure" in fields:
                six.append(np.trace(cauchy, axis1=-2, axis2=-1)[..., None] / 3.0)
            yield some, np.concatenate(six, axis=-1).reshape(*u.shape, len(xi), -1)

    @cached_property
    def _topology(self) -> tuple[Index, Index, Array, Index]:
        """Return types, connectivity as VTK has it, degrees ``(cells, 3)`` and elements of all cells."""
        p, across = self._steps.shape[1] - 1, self.patches.weights.size
        kinds, one, degrees = [], [], []
        for shape, nodes in zip(self.patches.shapes, self.patches.nodes, strict=True):
            order, layer = _order(shape, p)
            one.append(nodes[order] + across * layer)
            kinds.append(_WEDGE if len(shape.degrees) == 1 else _HEXAHEDRON)
            degrees.append((*(shape.degrees * 2)[:2], p))
        starts = np.arange(len(self._steps)) * (p + 1) * across
        connectivity = [np.concatenate([[cell.size], cell + start]) for start in starts for cell in one]
        elements = np.repeat(np.arange(starts.size) // self._parts, len(one))
        return (
            np.tile(np.array(kinds, dtype=np.uint8), starts.size),
            np.concatenate(connectivity),
            np.tile(np.array(degrees, dtype=float), (starts.size, 1)),
            elements,
        )


# vtkCellType, and vtkDataSetAttributes::AttributeTypes.
_HEXAHEDRON, _WEDGE = 79, 80
_LINEAR_HEXAHEDRON, _LINEAR_WEDGE = 12, 13
_RATIONAL, _DEGREES = 9, 10


@lru_cache(maxsize=32)
def _kept_order(degrees: tuple[int, ...], p: int) -> tuple[Index, Index]:
    from vtkmodules.vtkCommonDataModel import vtkHigherOrderHexahedron, vtkHigherOrderWedge

    powers = shape_of(degrees[-1], len(degrees) == 1).powers
    count = len(powers) * (p + 1)
    found = np.empty(count, dtype=np.int64)
    for layer in range(p + 1):
        for m, (i, j) in enumerate(powers.tolist()):
            if len(degrees) == 1:
                place = vtkHigherOrderWedge.PointIndexFromIJK(i, j, layer, [degrees[0], degrees[0], p, count])
            else:
                place = vtkHigherOrderHexahedron.PointIndexFromIJK(i, j, layer, [*degrees, p])
            found[place] = layer * len(powers) + m
    return found % len(powers), found // len(powers)


def _order(shape: Shape, p: int) -> tuple[Index, Index]:
    """Return polynomial and layer of each point of a cell, in VTK's order."""
    return _kept_order(shape.degrees, p)


def in_small_cells(mesh: "pyvista.UnstructuredGrid", parts: int = 4) -> "pyvista.UnstructuredGrid":
    """Return Bezier cells as small linear ones, ``parts`` along each edge, with their fields; other cells as they are.

    VTK's own filters take a hundred times as long for cells of a high degree.
    """
    import pyvista

    degrees = mesh.GetCellData().GetHigherOrderDegrees()
    if degrees is None:
        return mesh
    orders = pyvista.convert_array(degrees).astype(int)
    weights = mesh.point_data["RationalWeights"]
    offsets = pyvista.convert_array(mesh.GetCells().GetOffsetsArray())
    names = [name for name in mesh.point_data if name != "RationalWeights"]
    points, corners, kinds, elements, total = [], [], [], [], 0
    fields: dict[str, list[Array]] = {name: [] for name in names}
    for key in {(kind, *order) for kind, order in zip(mesh.celltypes.tolist(), orders.tolist(), strict=True)}:
        chosen = np.flatnonzero((mesh.celltypes == key[0]) & (orders == key[1:]).all(axis=1))
        values, cell, kind = _lattice(key[0] == _WEDGE, key[1], key[2], key[3], parts)
        count = values.shape[1]
        ids = mesh.cell_connectivity[offsets[chosen, None] + np.arange(count)]
        share = values * weights[ids][:, None, :]
        share /= share.sum(axis=2, keepdims=True)
        points.append((share @ mesh.points[ids]).reshape(-1, 3))
        for name in names:
            own = mesh.point_data[name]
            found = share @ own[ids].reshape(*ids.shape, -1)
            fields[name].append(found.reshape(-1, *own.shape[1:]))
        starts = total + len(values) * np.arange(chosen.size)
        corners.append((starts[:, None, None] + cell).reshape(-1, cell.shape[1]))
        kinds.append(np.full(len(corners[-1]), kind, dtype=np.uint8))
        elements.append(np.repeat(mesh.cell_data["element"][chosen], len(cell)))
        total += len(values) * chosen.size
    connectivity = np.concatenate([np.insert(one, 0, one.shape[1], axis=1).ravel() for one in corners])
    found = pyvista.UnstructuredGrid(connectivity, np.concatenate(kinds), np.concatenate(points))
    for name in names:
        found.point_data[name] = np.concatenate(fields[name])
    found.cell_data["element"] = np.concatenate(elements)
    for name, values in mesh.field_data.items():
        found.field_data[name] = values
    return found


@lru_cache(maxsize=32)
def _lattice(triangle: bool, first: int, second: int, p: int, parts: int) -> tuple[Array, Index, int]:
    """Return polynomials of a cell, in VTK's order, on a lattice ``(points, m)``; its linear cells and their type."""
    degrees = (first,) if triangle else (first, second)
    steps = np.arange(parts + 1)
    powers = shape_of(second, triangle).powers
    if triangle:
        nodes = [(i, j) for j in steps for i in steps[: parts + 1 - j]]
        number = {node: k for k, node in enumerate(nodes)}
        # Linear wedges have their first triangle the other way round.
        faces = [[number[i, j], number[i, j + 1], number[i + 1, j]] for i, j in nodes if i + j < parts]
        faces += [[number[i + 1, j], number[i, j + 1], number[i + 1, j + 1]] for i, j in nodes if i + j < parts - 1]
        across = triangular(first, powers, np.array(nodes) / parts)
    else:
        low = (steps[:-1, None] + (parts + 1) * steps[:-1]).ravel()
        faces = np.stack([low, low + 1, low + parts + 2, low + parts + 1], axis=1).tolist()
        one, two = (bernstein(degree, steps / parts) for degree in degrees)
        values = np.einsum("ia,jb->jiab", one, two).reshape((parts + 1) ** 2, first + 1, second + 1)
        across = values[:, powers[:, 0], powers[:, 1]]
    order, layer = _kept_order(degrees, p)
    along = bernstein(p, steps / parts)
    found = (along[:, None, :, None] * across[None, :, None, :]).reshape(-1, p + 1, across.shape[1])[:, layer, order]
    face, count = np.array(faces), len(across)
    cells = (np.concatenate([face, face + count], axis=1)[None] + count * steps[:-1, None, None]).reshape(
        -1, 2 * face.shape[1]
    )
    return found, cells, _LINEAR_WEDGE if triangle else _LINEAR_HEXAHEDRON


def _nodal(fields: Mapping[str, Array]) -> dict[str, Array]:
    return {name: nodal for name, nodal in fields.items() if name not in _OTHERS}


def _scaled(layers: Array) -> Array:
    """Return columns of coefficients ``(functions, layers 3)``, of size one, of a field ``(layers, functions, 3)``."""
    columns = layers.swapaxes(0, 1).reshape(layers.shape[1], -1)
    return columns / (np.abs(columns).max(initial=0.0) or 1.0)
