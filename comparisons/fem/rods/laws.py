"""The laws of a model's bodies on the cells of their mesh: one form for each kind of law, its constants fields."""

from typing import Any

import dolfinx.fem
import dolfinx.mesh
import numpy as np
import ufl

from comparisons.fem import compat, quadrature
from comparisons.fem.material import active_of, linear_of, neo_hookean_of, passive_of, st_venant_kirchhoff_of
from comparisons.fem.rods.elements import Elements
from comparisons.fem.rods.places import lagrange, on_rod
from isorod.errors import InputError
from isorod.material.law import Material
from isorod.material.muscle import Muscle
from isorod.model.model import Model
from meshes.mesh import Array, Index

# Kinds of law; their numbers in the forms begin with 1.
KINDS = ("LinearElastic", "NeoHookean", "StVenantKirchhoff", "Muscle")


class Laws:
    """The energy of a model's bodies, in UFL.

    Parameters
    ----------
    elements
        Mesh and space.
    model
        Bodies with their laws.
    rule
        Degree of the quadrature.

    Attributes
    ----------
    place
        Row of `laws` of each cell, in the source's order, shape ``(cells,)``.
    laws
        All laws and densities, a body's elements and rings one after the other.
    activation
        A dolfinx constant: the load factor, with which the activation of muscles grows.
    density
        Mass per volume, a dolfinx function constant on each cell.
    linear
        Whether all stiffness is constant.
    """

    def __init__(self, elements: Elements, model: Model, rule: int) -> None:
        self.elements, self.rule = elements, rule
        self.place, self.laws, densities = _places(elements, model)
        kinds = np.array([_kind(law) for law in self.laws])[self.place]
        self.present = sorted(set(kinds.tolist()))
        self.linear = self.present == [1]
        tags = kinds[elements.rows].astype(np.int32)
        where = np.arange(len(tags), dtype=np.int32)
        regions = dolfinx.mesh.meshtags(elements.mesh, 3, where, tags)
        self.dx = ufl.Measure("dx", domain=elements.mesh, subdomain_data=regions, metadata=quadrature.measure(rule))
        self.activation = dolfinx.fem.Constant(elements.mesh, 1.0)
        self.density = elements.constants(densities[self.place][:, None])[0]
        moduli = np.array([(law.mu, law.lame) for law in self.laws])  # type: ignore[attr-defined]
        if not np.isfinite(moduli).all():
            raise InputError("material: incompressible (nu = 0.5), which displacements alone cannot be")
        self.moduli = elements.constants(moduli[self.place])
        self._fibres: tuple[Any, Any] | None = None
        if 1 + KINDS.index("Muscle") in self.present:
            constants = np.array([_fibre_constants(law) for law in self.laws])
            self._fibres = elements.constants(constants[self.place]), self._directions()

    def energy(self, u: Any) -> Any:
        """Return the energy of a displacement: a sum of integrals."""
        F = ufl.Identity(3) + ufl.grad(u)
        return sum(self._density(KINDS[kind - 1], F) * self.dx(kind) for kind in self.present)

    def at_rest(self, u: Any) -> Any:
        """Return the energy of a small displacement from rest."""
        F = ufl.Identity(3) + ufl.grad(u)
        return sum(linear_of(*self._moduli)(F) * self.dx(kind) for kind in self.present)

    @property
    def _moduli(self) -> tuple[Any, Any]:
        return self.moduli[0], self.moduli[1]

    def _density(self, kind: str, F: Any) -> Any:
        if kind == "LinearElastic":
            return linear_of(*self._moduli)(F)
        if kind == "StVenantKirchhoff":
            return st_venant_kirchhoff_of(*self._moduli)(F)
        matrix = neo_hookean_of(*self._moduli)(F)
        if kind == "NeoHookean":
            return matrix
        assert self._fibres is not None
        constants, fibre = self._fibres
        active = self.activation * constants[0] * active_of(F, fibre)
        return matrix + active + passive_of(constants[1], constants[2], F, fibre)

    def _directions(self) -> Any:
        """Return the unit vectors along the fibres, polynomials in each cell between its nodes."""
        elements = self.elements
        mesh, degree = elements.source, elements.source.order
        space = compat.function_space(elements.mesh, compat.block_element(elements.mesh, "DQ", degree, 3))
        found = dolfinx.fem.Function(space)
        where = compat.interpolation_points(space)
        parameters = np.einsum("qn,cnp->cqp", lagrange(degree, mesh.reference, where), elements.parameters)
        fibres = np.zeros((*parameters.shape[:2], 3))
        fibres[..., 2] = 1.0
        for k, law in enumerate(self.laws):
            cells = np.flatnonzero(self.place == k)
            if isinstance(law, Muscle) and cells.size:
                there = on_rod(elements.rods[elements.rod_of[cells[0]]], parameters[cells])
                fibres[cells] = law.placed(there).fibres(there.shape)
        dofs = compat.cell_dofs(space, len(elements.rows))
        found.x.array.reshape(-1, 3)[dofs] = fibres[elements.rows]
        return found / ufl.sqrt(ufl.inner(found, found))


def _places(elements: Elements, model: Model) -> tuple[Index, list[Material], Array]:
    """Return `Laws.place`, all laws, and the density of each."""
    place = np.empty(len(elements.source.cells), dtype=np.int64)
    laws: list[Material] = []
    densities = []
    for b, body in enumerate(model.bodies):
        radius, u = elements.middles(b)
        rings = len(body.space.rod.rings) - 1
        element = np.searchsorted(body.space.axis.breaks[1:-1], u, side="right")
        ring = np.searchsorted(body.space.rod.rings[1:-1], radius, side="right")
        place[elements.cells(b)] = len(laws) + element * rings + ring
        laws += body.laws
        densities.append(body.densities)
    return place, laws, np.concatenate(densities)


def _kind(law: Material) -> int:
    name = type(law).__name__
    if name not in KINDS:
        raise InputError(f"material {name}: the finite element side has {', '.join(KINDS)}")
    return 1 + KINDS.index(name)


def _fibre_constants(law: Material) -> tuple[float, float, float]:
    """Return active stress at full load, ``m1`` and ``m2``, of which the last may not be zero in the energy."""
    if not isinstance(law, Muscle):
        return 0.0, 0.0, 1.0
    passive = law.m1 > 0.0 and law.m2 > 0.0
    return law.activation * law.sigma_max, law.m1 if passive else 0.0, law.m2 if passive else 1.0
