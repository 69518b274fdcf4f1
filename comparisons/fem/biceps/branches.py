"""The biceps' two branches in dolfinx: isoparametric displacement, laws of tendon and muscle, held ends.  Serial."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import dolfinx.fem
import dolfinx.mesh
import numpy as np
import ufl
from mpi4py import MPI

from comparisons.fem import quadrature
from comparisons.fem.numbering import Numbered
from isorod.fenics import compat
from isorod.fenics.flags import FAST
from isorod.fenics.stored import Energy, energy_of
from isorod.material import NeoHookean
from isorod.material.muscle import Muscle
from isorod.scenes.biceps import Biceps
from meshes.biceps import BRANCHES
from meshes.mesh import Array, Index, Mesh, match

ENDS = tuple(f"{branch} {end}" for branch in BRANCHES for end in ("start", "end"))
_TENDONS, _MUSCLE = 1, 2


@dataclass(frozen=True, eq=False)
class End:
    """An end face that does not move, in the form in which `comparisons.fem.statics` takes supports."""

    condition: Any
    dofs: Index
    components: Index
    unit: Array


class Branches(Numbered):
    """Both branches as one dolfinx mesh whose parts have no node in common.

    Parameters
    ----------
    scene
        The laws' parameters and the rods.
    mesh
        From `meshes.biceps.build`, of order 1 or 2.
    rule
        Quadrature degree.
    flags
        C compiler flags.
    mixed
        Whether pressures are unknowns too, of one degree less (Taylor-Hood), in units of the muscle's shear modulus.

    Attributes
    ----------
    state
        The displacement, with the pressure if it is mixed; a dolfinx function.
    space
        That of displacements.
    activation
        A dolfinx constant.
    node_dofs
        Blocked degree of freedom of each of the mesh's nodes, shape ``(nodes,)``.
    """

    def __init__(self, scene: Biceps, mesh: Mesh, rule: int, flags: Sequence[str] = FAST, mixed: bool = False) -> None:
        self.scene, self.source, self.rule, self.flags, self.mixed = scene, mesh, rule, flags, mixed
        order = match(mesh.reference, compat.reference_nodes(mesh.shape, mesh.order))
        self.mesh = compat.create_mesh(MPI.COMM_SELF, mesh.cells[:, order], mesh.points, mesh.shape, mesh.order)
        element = compat.element(self.mesh, "Lagrange", mesh.order, 3)
        self.space = compat.function_space(self.mesh, element)
        if mixed:
            pressure = compat.element(self.mesh, "Lagrange", mesh.order - 1)
            mixed_space = compat.function_space(self.mesh, compat.mixed_element([element, pressure]))
            self.space, self._among = mixed_space.sub(0).collapse()
            self.state = dolfinx.fem.Function(mixed_space)
        else:
            self.state = dolfinx.fem.Function(self.space)
        self.activation = dolfinx.fem.Constant(self.mesh, 0.0)
        rows = compat.original_cells(self.mesh)
        self.node_dofs: Index = np.empty(len(mesh.points), dtype=np.int64)
        self.node_dofs[mesh.cells[rows][:, order]] = compat.cell_dofs(self.space, len(rows))
        tags = np.full(len(mesh.cells), _TENDONS, dtype=np.int32)
        for branch in BRANCHES:
            tags[mesh.regions[f"{branch} muscle"]] = _MUSCLE
        self._tags = tags[rows]
        regions = dolfinx.mesh.meshtags(self.mesh, 3, np.arange(len(rows), dtype=np.int32), self._tags)
        dx = ufl.Measure("dx", domain=self.mesh, subdomain_data=regions, metadata=quadrature.measure(rule))
        self._parts = [(self._tendon, dx(_TENDONS)), (self._muscle, dx(_MUSCLE))]
        displacement, pressure = ufl.split(self.state) if mixed else (self.state, None)
        F = ufl.Identity(3) + ufl.grad(displacement)
        self._stored = sum(law(F) * part for law, part in self._parts)
        if pressure is not None:
            p, log = self._materials[1].mu * pressure, ufl.ln(ufl.det(F))
            for law, (_, part) in zip(self._materials, self._parts, strict=True):
                self._stored += (p * log - (0.5 / law.lame) * p**2) * part
        self._virtual_work = ufl.derivative(self._stored, self.state, ufl.TestFunction(self.state.function_space))

    @property
    def places(self) -> Index:
        """Place of the coefficients of each node among all unknowns, shape ``(nodes, 3)``."""
        own = super().places
        return np.asarray(self._among)[own] if self.mixed else own

    @property
    def unknowns(self) -> int:
        """Number of degrees of freedom, held ones and pressures included."""
        return int(self.state.x.array.size)

    def laws(self) -> list[tuple[Energy, Index]]:
        """Return tendon and muscle, each with its cells."""
        return [
            (law, np.flatnonzero(self._tags == tag)) for law, tag in ((self._tendon, _TENDONS), (self._muscle, _MUSCLE))
        ]

    @property
    def _materials(self) -> tuple[NeoHookean, Muscle]:
        """Isorod's laws of tendon and muscle, the latter at full activation."""
        scene = self.scene
        tendon = NeoHookean(scene.tendon_factor * scene.E, scene.nu)
        return tendon, Muscle(scene.E, scene.nu, scene.sigma_max, scene.m1, scene.m2, 1.0)

    @property
    def _tendon(self) -> Energy:
        law = self._materials[0]
        return energy_of(law.shear if self.mixed else law)

    @property
    def _muscle(self) -> Energy:
        law = self._materials[1]
        return energy_of(law.shear if self.mixed else law, self.activation, (self._fibre(),))

    def _fibre(self) -> Any:
        if self.scene.fibre == "y":
            return ufl.as_vector([0.0, 1.0, 0.0])
        # The centre lines' tangents at the nodes, and unit vectors between them.
        assert self.source.parameters is not None
        nodal = np.empty((len(self.source.points), 3))
        for branch, rod in zip(BRANCHES, self.scene.rods(), strict=True):
            nodes = np.unique(
                np.concatenate(
                    [
                        self.source.cells[self.source.regions[f"{branch} {part}"]].ravel()
                        for part in ("muscle", "tendons")
                    ]
                )
            )
            nodal[nodes] = rod.tangents(self.source.parameters[nodes, 2])
        field = dolfinx.fem.Function(self.space)
        field.x.array[super().places] = nodal
        return field / ufl.sqrt(ufl.inner(field, field))

    @cached_property
    def residual(self) -> Any:
        """The internal forces, a compiled form."""
        return compat.form(self._virtual_work, self.flags)

    @cached_property
    def tangent(self) -> Any:
        """Their derivative, a compiled form."""
        trial = ufl.TrialFunction(self.state.function_space)
        return compat.form(ufl.derivative(self._virtual_work, self.state, trial), self.flags)

    @cached_property
    def energy(self) -> Any:
        """The stored energy, a compiled form."""
        return compat.form(self._stored, self.flags)

    def compile(self) -> None:
        """Make all forms, compiled or from the cache."""
        for form in ("residual", "tangent", "energy"):
            getattr(self, form)

    def stored(self) -> float:
        """Return the stored energy of tendons and muscles at the present state and activation."""
        return float(dolfinx.fem.assemble_scalar(self.energy))

    def ends(self) -> list[End]:
        """Return the four held ends, in the order of `ENDS`."""
        zero = dolfinx.fem.Function(self.space)
        ends = []
        for name in ENDS:
            blocks = np.sort(self.node_dofs[np.unique(self.source.faces[name])]).astype(np.int32)
            dofs = own = (3 * blocks[:, None] + np.arange(3, dtype=np.int32)).ravel()
            if self.mixed:
                dofs = np.asarray(self._among, dtype=np.int32)[own]
                condition = dolfinx.fem.dirichletbc(zero, [dofs, own], self.state.function_space.sub(0))
            else:
                condition = dolfinx.fem.dirichletbc(zero, blocks)
            ends.append(End(condition, dofs, own % 3, np.ones(dofs.size)))
        return ends
