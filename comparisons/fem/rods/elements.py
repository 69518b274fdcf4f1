"""A mesh of rods, perhaps with bodies, in dolfinx: isoparametric displacement at the mesh's nodes."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import basix
import dolfinx.fem
import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc

from comparisons.fem.numbering import Numbered
from isorod.errors import InputError
from isorod.fenics import compat
from isorod.geometry.rod import Rod
from meshes.mesh import Array, Index, Mesh, match

# A node is on a section if its axis parameter is that of the section to this fraction of the axis.
_SAME = 1e-9


class Elements(Numbered):
    """A mesh handed to dolfinx, and which rod or body each node, cell and facet belongs to.

        Parameters
        ----------
        mesh
            Cells with parameters, regions ``"rod 0"`` ... and faces ``"rod 0 start"``, ``"rod 0 end"``,
            ``"rod 0 lateral"``, ``"rod 0 inner"`` ... (as far as there are such); perhaps regions ``"solid 0"`` ...
        rods
    Of the mesh.
        mixed
            Numbers of the rods in which pressures are unknowns too, see `pressures`.
        comm
            The ranks among which dolfinx divides the cells.  All of them have the whole mesh.

        Attributes
        ----------
        source
            The `Mesh`.
        mesh, space, state
            The dolfinx mesh, the space of displacements, and a function of all unknowns: displacements alone, or with
            pressures.
        mixed
            Whether pressures are unknowns of each cell, in the source's order, shape ``(cells,)``.
        idle
            Unknowns that belong to no such cell: pressures, which are held at zero.
        rows
            Row in the source's cells of each of this rank's dolfinx cells, shape ``(cells,)``.
        node_dofs
            Blocked degree of freedom of each node, shape ``(nodes,)``, -1 of those that this rank's cells do not have.
        rod_of
            Number of each cell's rod, -1 of those of bodies, in the source's order, shape ``(cells,)``.
    """

    def __init__(self, mesh: Mesh, rods: list[Rod], mixed: Sequence[int] = (), comm: MPI.Comm = MPI.COMM_SELF) -> None:
        missing = [name for k in range(len(rods)) if (name := f"rod {k}") not in mesh.regions]
        if missing or mesh.parameters is None:
            raise InputError("mesh: need cells with parameters and a region for each rod: rod 0, rod 1, ...")
        self.source, self.rods = mesh, rods
        order = match(mesh.reference, compat.reference_nodes(mesh.shape, mesh.order))
        mine = slice(None if comm.rank == 0 else 0)
        cells, points = mesh.cells[mine, order], mesh.points[mine]
        self.comm, self.mesh = comm, compat.create_mesh(comm, cells, points, mesh.shape, mesh.order)
        displacement = compat.element(self.mesh, "Lagrange", mesh.order, 3, equispaced=True)
        self.space = compat.function_space(self.mesh, displacement)
        self.rows = compat.original_cells(self.mesh)
        self.node_dofs: Index = np.full(len(mesh.points), -1)
        self._nodes = mesh.cells[self.rows][:, order]
        self.node_dofs[self._nodes] = compat.cell_dofs(self.space, len(self.rows))
        self.rod_of: Index = np.full(len(mesh.cells), -1)
        for k in range(len(rods)):
            self.rod_of[mesh.regions[f"rod {k}"]] = k
        self.mixed: Any = np.isin(self.rod_of, list(mixed))
        self.idle: Index = np.empty(0, dtype=np.int64)
        self._among: Index | None = None
        whole = self._with_pressures(displacement) if len(mixed) else self.space
        self.state = dolfinx.fem.Function(whole)

    def _with_pressures(self, displacement: Any) -> Any:
        """Return the space of displacements and pressures, of one degree less.

        Of bricks those of each cell are polynomials for themselves, so that they jump where laws do; tetrahedra have
        Taylor and Hood's, which do not.
        """
        bricks, order = self.source.shape == "hexahedron", self.source.order
        if order < 2:
            raise InputError("degree: got 1, pressures (nearly incompressible laws) need displacements of degree 2")
        pressure = compat.element(self.mesh, "DPC" if bricks else "Lagrange", order - 1)
        whole = compat.function_space(self.mesh, compat.mixed_element([displacement, pressure]))
        self.space, self._among = compat.collapsed(whole.sub(0))
        self.node_dofs[self._nodes] = compat.cell_dofs(self.space, len(self.rows))
        alone, among = compat.collapsed(whole.sub(1))
        of_cells = compat.cell_dofs(alone, len(self.rows))
        acting = np.zeros(len(among))
        acting[of_cells[self.mixed[self.rows]]] = 1.0
        # Of tetrahedra's pressures another rank's cells may be those in which they act.
        acting = self._of_all(alone, acting)
        self.idle = np.sort(among[acting == 0.0])
        return whole

    def _of_all(self, space: Any, values: Array) -> Array:
        """Return the sums over all ranks of their values of a space's degrees of freedom."""
        function = dolfinx.fem.Function(space)
        vector = compat.petsc_vector(function)
        function.x.array[:] = values
        vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        vector.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
        return np.array(function.x.array)

    @cached_property
    def here(self) -> Index:
        """The nodes that this rank's cells have, sorted."""
        return np.flatnonzero(self.node_dofs >= 0)

    @cached_property
    def places(self) -> Index:  # type: ignore[override]
        """Place of the coefficients of each node on this rank, shape ``(nodes, 3)``; negative if it lacks the node."""
        places = super().places
        if self._among is not None:
            places[self.here] = self._among[places[self.here]]
        return np.where(self.node_dofs[:, None] < 0, -1, places)

    @cached_property
    def _mine(self) -> Index:
        """The nodes whose coefficients are this rank's own."""
        return np.flatnonzero((self.places[:, 0] >= 0) & (self.places[:, 0] < self.own))

    @property
    def own(self) -> int:
        """Number of unknowns that are this rank's own; those behind them are known to it and another's."""
        dofmap = self.state.function_space.dofmap
        return int(dofmap.index_map.size_local * dofmap.index_map_bs)

    @cached_property
    def numbers(self) -> Index:  # type: ignore[override]
        """Number of the coefficients of each node among those of all ranks, shape ``(nodes, 3)``."""
        dofmap = self.state.function_space.dofmap
        first = dofmap.index_map.local_range[0] * dofmap.index_map_bs
        return np.rint(self.to_nodes(np.arange(first, first + self.own, dtype=float))).astype(np.int64)

    def to_dofs(self, nodal: Array) -> Array:
        """Return values by node ``(nodes, 3)`` as this rank's coefficients, zero for other unknowns."""
        result = np.zeros(self.unknowns)
        result[self.places[self.here]] = nodal[self.here]
        return result

    def to_nodes(self, coefficients: Array) -> Array:
        """Return the ranks' coefficients that are displacements by node, shape ``(nodes, 3)``; all have to ask."""
        nodal = np.zeros((len(self.node_dofs), 3))
        nodal[self._mine] = coefficients[self.places[self._mine]]
        return nodal if self.comm.size == 1 else np.asarray(self.comm.allreduce(nodal))

    def count(self, dofs: Index) -> int:
        """Return how many degrees of freedom the ranks own among some; all have to ask."""
        return int(self.comm.allreduce(int(np.count_nonzero(dofs < self.own))))

    @property
    def unknowns(self) -> int:
        """Number of unknowns that this rank knows, held and idle ones included."""
        return int(self.state.x.array.size)

    @property
    def split(self) -> tuple[Any, Any]:
        """The displacement, and the pressure or None, in UFL."""
        return (self.state, None) if self._among is None else ufl.split(self.state)

    @cached_property
    def dofs(self) -> int:
        """Number of degrees of freedom of all ranks, held ones included, without those that are idle."""
        return self.count(np.arange(self.own)) - self.count(self.idle)

    @property
    def family(self) -> str:
        """UFL's name of polynomials in each cell for itself."""
        return "DQ" if self.source.shape == "hexahedron" else "DG"

    def nodal_pressure(self, unit: float, flags: Sequence[str]) -> Array | None:
        """Return the present pressure at the nodes of each cell, ``(cells, nodes per cell)``; NaN where it is none."""
        _, pressure = self.split
        if pressure is None:
            return None
        at = compat.expression(unit * pressure, self.source.reference, flags)
        own = self.mesh.topology.index_map(3).size_local
        nodal = np.zeros(self.source.cells.shape)
        nodal[self.rows[:own]] = at(self.mesh, np.arange(own, dtype=np.int32))
        nodal = np.asarray(self.comm.allreduce(nodal))
        nodal[~self.mixed] = np.nan
        return nodal

    def cells(self, rod: int) -> Index:
        """Return the numbers of a rod's cells in the source."""
        return np.asarray(self.source.regions[f"rod {rod}"])

    @cached_property
    def parameters(self) -> Array:
        """Parameters ``xi_1, xi_2, u`` of each cell's nodes, shape ``(cells, nodes per cell, 3)``.

        In the cells in which a closed rod meets its start, those of ``u`` that are beyond its end go on growing.  Cells
        of bodies have none, zeros.
        """
        parameters = np.zeros((*self.source.cells.shape, 3))
        for k, rod in enumerate(self.rods):
            cells = self.cells(k)
            parameters[cells] = self.source.parameters_in(k, self.source.cells[cells])
            if rod.closed:
                low, high = rod.axis.breaks[[0, -1]]
                u = parameters[cells, :, 2]
                beyond = (np.ptp(u, axis=1) > 0.5 * (high - low))[:, None] & (u < 0.5 * (low + high))
                parameters[cells, :, 2] = u + (high - low) * beyond
        return parameters

    def middles(self, rod: int) -> tuple[Array, Array]:
        """Return of a rod's cells the mean distance from the disk's centre and the mean axis parameter."""
        parameters = self.parameters[self.cells(rod)]
        low, high = self.rods[rod].axis.breaks[[0, -1]]
        radius = np.hypot(parameters[..., 0], parameters[..., 1]).mean(axis=1)
        return radius, low + np.mod(parameters[..., 2].mean(axis=1) - low, high - low)

    def constants(self, values: Array) -> Any:
        """Return the dolfinx function with these values ``(cells, m)``, in the source's order, constant on each."""
        space = compat.function_space(self.mesh, compat.element(self.mesh, self.family, 0, values.shape[1]))
        function = dolfinx.fem.Function(space)
        where = compat.cell_dofs(space, len(self.rows))[:, 0]
        function.x.array.reshape(-1, values.shape[1])[where] = values[self.rows]
        return function

    @cached_property
    def _sides(self) -> tuple[Index, Index]:
        """Corners of all cells' sides, sorted, shape ``(s cells, 3 or 4)``, and places of each side's nodes ``(s, n)``.

        Sides are ordered as dolfinx has them.
        """
        cell = getattr(basix.CellType, self.source.shape)
        corners = np.asarray(basix.geometry(cell))
        places, ends = [], []
        for vertices in basix.topology(cell)[2]:
            a, b, c = corners[vertices[:3]]
            (on,) = np.nonzero(np.abs((self.source.reference - a) @ np.cross(b - a, c - a)) < _SAME)
            places.append(on)
            ends.append(on[np.isin(self.source.reference[on], (0.0, 1.0)).all(axis=1)])
        sides = np.sort(self.source.cells[:, np.array(ends)].reshape(-1, len(ends[0])), axis=1)
        return sides, np.array(places)

    def facets(self, name: str) -> Index:
        """Return this rank's dolfinx facets of a named face, sorted."""
        face = self.source.faces[name]
        corners = np.isin(self.source.face_reference, (0.0, 1.0)).all(axis=1)
        targets = np.sort(face[:, corners], axis=1)
        sides, places = self._sides
        numbers = np.flatnonzero(_is_among(sides, targets))
        if len(numbers) != len(face):
            raise InputError(f"mesh: face {name} is not the surface of cells")
        topology = self.mesh.topology
        topology.create_connectivity(3, 2)
        local = np.full(len(self.source.cells), -1)
        local[self.rows] = np.arange(len(self.rows))
        numbers = numbers[local[numbers // len(places)] >= 0]
        table = np.asarray(topology.connectivity(3, 2).array).reshape(-1, len(places))
        return np.sort(table[local[numbers // len(places)], numbers % len(places)]).astype(np.int32)

    def section(self, rod: int, u: float) -> Index:
        """Return the facets of a rod's section at an axis parameter, node numbers ordered as faces are ``(m, n)``.

        Raises
        ------
        InputError
            If it cuts through cells.
        """
        low, high = self.rods[rod].axis.breaks[[0, -1]]
        slack = _SAME * (high - low)
        for name, end in ((f"rod {rod} start", low), (f"rod {rod} end", high)):
            if name in self.source.faces and abs(u - end) <= slack:
                return np.asarray(self.source.faces[name])
        if self.source.shape != "hexahedron":
            raise InputError(f"section at u = {u:g} of rod {rod}: tetrahedra have none but the ends")
        on = np.abs(self.parameters[self.cells(rod)][:, :, 2] - u) <= slack
        above = self.parameters[self.cells(rod)][:, :, 2].mean(axis=1) > u
        _, places = self._sides
        facets = []
        for side in places:
            chosen = self.cells(rod)[above & on[:, side].all(axis=1)]
            # The side's two directions, the first one faster, as a face has them.
            position = self.source.reference[side]
            flat = np.delete(position, int(np.argmin(np.ptp(position, axis=0))), axis=1)
            facets.append(self.source.cells[chosen][:, side[match(flat, self.source.face_reference)]])
        faces = np.concatenate(facets)
        if not len(faces):
            raise InputError(f"section at u = {u:g} of rod {rod}: it lies within cells of the mesh")
        return faces


def _is_among(rows: Index, others: Index) -> Any:
    """Return whether each of some rows is among others, shape ``(rows,)``."""
    inverse = np.unique(np.concatenate([rows, others]), axis=0, return_inverse=True)[1].ravel()
    return np.isin(inverse[: len(rows)], inverse[len(rows) :])
