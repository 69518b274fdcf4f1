"""The laws of a model's bodies on the cells of their mesh: one form for each stored energy, its constants fields."""

from collections.abc import Callable
from typing import Any

import dolfinx.fem
import dolfinx.mesh
import numpy as np
import ufl

from comparisons.fem import quadrature
from comparisons.fem.rods.elements import Elements
from comparisons.fem.rods.places import on_rod
from isorod.fenics import compat
from isorod.fenics.stored import constants_of, density, density_of
from isorod.material import symbols
from isorod.material.law import Material
from isorod.model.model import Model
from meshes.mesh import Array, Index
from meshes.within import lagrange

# Compression of bodies at rest (`Laws.at_rest`).
_SLACK = 1e-12


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
        All laws and densities, a rod's elements and rings one after the other, those of bodies last.
    activation
        A dolfinx constant: the load factor, with which the activation of muscles and temperatures grow.
    unit
        What pressures are counted in: the middle shear modulus, force / area.
    density
        Mass per volume, a dolfinx function constant on each cell.
    """

    def __init__(self, elements: Elements, model: Model, rule: int) -> None:
        self.elements, self.rule = elements, rule
        self.place, self.laws, densities = places_of(elements, model)
        mixed = np.zeros(len(self.laws), dtype=bool)
        mixed[self.place[elements.mixed]] = True
        stored = [law.stored for law in self.laws]
        # In the order in which they come first: energies, and whether pressures are beside them, of which measure.
        keys = [
            (one.expression, bool(with_pressure), law.logarithmic if with_pressure else None)
            for one, law, with_pressure in zip(stored, self.laws, mixed, strict=True)
        ]
        self._kinds = list(dict.fromkeys(keys))
        self._energies = [stored[keys.index(key)] for key in self._kinds]
        kinds = np.array([1 + self._kinds.index(key) for key in keys])[self.place]
        self.present = sorted(set(kinds.tolist()))
        tags = kinds[elements.rows].astype(np.int32)
        where = np.arange(len(tags), dtype=np.int32)
        regions = dolfinx.mesh.meshtags(elements.mesh, 3, where, tags)
        self.dx = ufl.Measure("dx", domain=elements.mesh, subdomain_data=regions, metadata=quadrature.measure(rule))
        self.activation = dolfinx.fem.Constant(elements.mesh, 1.0)
        self.density = elements.constants(densities[self.place][:, None])[0]
        # What a pressure of one takes of the volume is a field behind the constants.
        constants = np.zeros((len(self.laws), 1 + max(len(one.constants) for one in stored)))
        for k in np.unique(self.place):
            law = self.laws[k]
            constants[k, : len(law.constants)] = constants_of(law.shear if mixed[k] else law)
            constants[k, -1] = 1.0 / law.lame if mixed[k] else 0.0
        self._constants = elements.constants(constants[self.place])
        self.unit = float(np.median([law.shear_modulus for law in self.laws]))
        self._fibres = self._directions()

    def energy(self) -> Any:
        """Return the energy of the state, a sum of integrals; with pressures the functional stationary in them."""
        u, pressure = self.elements.split
        F = ufl.Identity(3) + ufl.grad(u)
        total = sum(self._density(kind, F, self.activation) * self.dx(kind) for kind in self.present)
        return total + self._volumetric(pressure, lambda log: ufl.ln(ufl.det(F)) if log else ufl.div(u))

    def at_rest(self) -> Any:
        """Return the energy of a small displacement from rest, with no activation: a sum of integrals."""
        i, j, k, m = ufl.indices(4)
        u, pressure = self.elements.split
        # Slightly compressed: fibres that bear tension alone are slack; at rest their stretch is 1 up to rounding.
        rest, turned = ufl.variable((1.0 - _SLACK) * ufl.Identity(3)), ufl.grad(u)
        total = 0.0
        for kind in self.present:
            moduli = ufl.diff(ufl.diff(self._density(kind, rest, 0.0), rest), rest)
            total += 0.5 * moduli[i, j, k, m] * turned[i, j] * turned[k, m] * self.dx(kind)
        return total + self._volumetric(pressure, lambda _: ufl.div(u))

    def between(self, before: Any, place: Any, test: Any) -> Any:
        """Return the virtual work of the stress at ``place``, 0 to 1, between a displacement and the state.

        See `isorod.fenics.forms.between`; of laws of small strains it is that in the middle.
        """
        u, _ = self.elements.split
        first, last = (ufl.Identity(3) + ufl.grad(energy) for energy in (before, u))
        middle = 0.5 * (first + last)
        total = 0.0
        for kind in self.present:
            energy = self._energies[kind - 1]
            given = self._given(energy, self.activation)
            if energy.small:
                F = ufl.variable(middle)
                stress = ufl.diff(density(energy.expression, F, given, self._fibres), F)
            else:
                C = first.T * first
                C = ufl.variable(C + place * (last.T * last - C))
                slope = ufl.diff(density_of(energy.expression, C, given, self._fibres), C)
                stress = middle * (slope + slope.T)
            total += ufl.inner(stress, ufl.grad(test)) * self.dx(kind)
        return total

    def _volumetric(self, pressure: Any, theta: Callable[[bool], Any]) -> Any:
        """Return the pressures' part of the energy, ``p theta - p^2 / (2 lame)`` where they act."""
        total = 0.0
        for kind in self.present:
            _, mixed, logarithmic = self._kinds[kind - 1]
            if mixed:
                p, soft = self.unit * pressure, self._constants[len(self._constants) - 1]
                total += (p * theta(logarithmic) - 0.5 * soft * p**2) * self.dx(kind)
        return total

    def _density(self, kind: int, F: Any, activation: Any) -> Any:
        energy = self._energies[kind - 1]
        return density(energy.expression, F, self._given(energy, activation), self._fibres)

    def _given(self, stored: Any, activation: Any) -> dict[Any, Any]:
        """Return the values of an energy's symbols; thermal strains grow with the activation."""
        given = {one: self._constants[k] for k, one in enumerate(stored.constants)}
        if symbols.heat in given:
            given[symbols.heat] *= activation
        return given | {symbols.activation: activation}

    def _directions(self) -> tuple[Any, ...]:
        """Return the unit vectors along each family of fibres, polynomials in each cell between its nodes."""
        elements = self.elements
        mesh, degree = elements.source, elements.source.order
        families = max(law.families for law in self.laws)
        if not families:
            return ()
        space = compat.function_space(elements.mesh, compat.element(elements.mesh, elements.family, degree, 3))
        where = compat.interpolation_points(space)
        parameters = np.einsum("qn,cnp->cqp", lagrange(degree, mesh.reference, where), elements.parameters)
        fibres = np.zeros((*parameters.shape[:2], 3 * families))
        fibres[..., 2::3] = 1.0
        for k, law in enumerate(self.laws):
            cells = np.flatnonzero(self.place == k)
            if law.families and cells.size:
                rod = elements.rod_of[cells[0]]
                placed = law if rod < 0 else law.placed(on_rod(elements.rods[rod], parameters[cells]))
                fibres[cells, :, : 3 * law.families] = placed.fibres(parameters[cells].shape[:2])
        dofs = compat.cell_dofs(space, len(elements.rows))
        made = []
        for family in range(families):
            field = dolfinx.fem.Function(space)
            field.x.array.reshape(-1, 3)[dofs] = fibres[elements.rows][:, :, 3 * family : 3 * family + 3]
            made.append(field / ufl.sqrt(ufl.inner(field, field)))
        return tuple(made)


def densities_of(elements: Elements, model: Model) -> Array:
    """Return the mass per volume of each cell, in the source's order, shape ``(cells,)``."""
    place, _, densities = places_of(elements, model)
    return np.asarray(densities[place])


def places_of(elements: Elements, model: Model) -> tuple[Index, list[Material], Array]:
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
    for k, solid in enumerate(model.solids):
        place[elements.source.regions[f"solid {k}"]] = len(laws)
        assert solid.law is not None
        laws.append(solid.law)
        densities.append(np.array([solid.density]))
    return place, laws, np.concatenate(densities)
