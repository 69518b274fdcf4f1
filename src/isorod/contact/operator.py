"""Contact as the assembler sees it: forces and exact tangent on the degrees of freedom of a model, of one rank."""

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.contact import cells, quality
from isorod.contact.force_kernel import add_forces
from isorod.contact.packed import Packed, Table
from isorod.contact.result import ContactResult, measure, sides_of, slave_points
from isorod.contact.tables import pack, points_of, smallest_radius
from isorod.contact.tangent_kernel import NODES, PATCH, add_blocks, find_patches, patch_nodes
from isorod.model.contact import MAX_POINTS, Contact, refuse
from isorod.model.model import Model

# Penetration up to which multipliers are added by default, relative to the smallest radius.
_DEEPEST = 1e-3


class ContactOperator:
    """Forces and tangent of all contacts of a model; closest points are sought anew at each call, without history.

    Attributes
    ----------
    packed
        What the compiled loops take and leave (`isorod.contact.packed`).
    points
        Points round an arc and along an element, of each side of the contacts.
    rows, columns, values
        The last tangent: repeated entries add up.
    version
        Counts how often the pattern of the tangent has changed.
    """

    def __init__(self, model: Model) -> None:
        refuse(model.contacts, faces=True)
        self._model = model
        self.points = points_of(model)
        self.packed = pack(model, self.points)
        self._stage = PETSc.Log.Stage("contact")
        self._base = np.concatenate([body.space.positions for body in model.bodies])
        self._patches = np.empty(0, PATCH)
        self._last = self._patches
        self.rows = self.columns = np.empty(0, dtype=np.int64)
        self.values = np.empty(0)
        self._begin = np.zeros(1, dtype=np.int64)
        self.version = 0

    def _positions(self, displacement: Array) -> Array:
        return self._base + displacement.reshape(-1, 3)

    def forces(self, displacement: Array) -> tuple[Array, float]:
        """Return the forces of contact on all degrees of freedom ``(dofs,)``, and its energy."""
        forces = np.zeros_like(self._base)
        self.packed.forget()
        with self._stage:
            pressing = add_forces(self.packed, self._positions(displacement), forces)
        return forces.ravel(), pressing.energy

    def tangent(self, displacement: Array) -> Array:
        """Set and return ``values``, the second derivatives of the energy at ``rows`` and ``columns``.

        Nodes of two sides (three control points by the layers of an element) that touch couple with each other.  Where
        a patch comes that is not in the pattern, the pattern is made anew of the patches of this call and the last one,
        and ``version`` grows.
        """
        self.forces(displacement)
        packed = self.packed
        active = np.flatnonzero(packed.states["pressure"] > 0.0)
        patches = np.empty(active.size, PATCH)
        find_patches(packed, active, patches)
        touched, which = np.unique(patches, return_inverse=True)
        if not np.isin(touched, self._patches).all():
            self._renew(np.union1d(touched, self._last))
        self._last = touched
        begin = self._begin[np.searchsorted(self._patches, touched)][which]
        self.values = np.zeros(self._begin[-1])
        with self._stage:
            add_blocks(packed, self._positions(displacement), active, patches, begin, self.values)
        return self.values

    def _renew(self, patches: Table) -> None:
        """Make the pattern anew, of dense blocks of the nodes of each of these patches, sorted."""
        self._patches = patches
        self.version += 1
        nodes = np.empty(NODES, dtype=np.int64)
        rows, columns, sizes = [], [], [0]
        for patch in patches:
            count = patch_nodes(self.packed, patch, nodes)
            dofs = (3 * nodes[:count, None] + np.arange(3)).ravel()
            rows.append(np.repeat(dofs, dofs.size))
            columns.append(np.tile(dofs, dofs.size))
            sizes.append(dofs.size**2)
        self.rows, self.columns = np.concatenate(rows), np.concatenate(columns)
        self._begin = np.cumsum(sizes)

    def product(self, move: Array) -> Array:
        """Return the last tangent times a vector of all degrees of freedom."""
        return np.bincount(self.rows, self.values * move[self.columns], move.size).astype(np.float64, copy=False)

    def results(self, displacement: Array, check: bool = False) -> list[ContactResult]:
        """Return the outcome of each contact at a displacement ``(dofs,)``; ``check`` tells the error of points too."""
        others = self._otherwise(displacement) if check else ()
        self.forces(displacement)
        return measure(self._model, self.packed, self._positions(displacement), others)

    def _otherwise(self, displacement: Array) -> list[tuple[float, float] | None]:
        """Return force and largest pressure of each contact as half as many points again see them, if they can."""
        finer = [tuple(min(MAX_POINTS, count + (count + 1) // 2) for count in pair) for pair in self.points]
        packed = self._packed([(pair[0], pair[1]) for pair in finer])
        positions = self._positions(displacement)
        add_forces(packed, positions, np.zeros_like(positions))
        found: list[tuple[float, float] | None] = []
        for (_, passes), (_, chosen) in zip(sides_of(self._model), slave_points(self._model, packed), strict=True):
            pressure = packed.states["pressure"][chosen]
            same = all(finer[k] == self.points[k] for k in passes)
            found.append(None if same else (float(packed.areas[chosen] @ pressure), float(pressure.max(initial=0.0))))
        return found

    def _packed(self, points: list[tuple[int, int]]) -> Packed:
        """Return tables with other points, with the multipliers and penalties of now."""
        packed = pack(self._model, points)
        packed.passes["penalty"] = self.packed.passes["penalty"]
        packed.multipliers[:] = cells.moved(self.packed, self.packed.multipliers, packed)
        return packed

    def space_evenly(self) -> None:
        """Let points that nobody gave be as close along the axis as round the section."""
        self.points = points_of(self._model, even=True)
        self.packed = pack(self._model, self.points)

    def see_better(self, displacement: Array) -> bool:
        """Take more points, where nobody gave them, if too few are across a patch; return whether there are more."""
        self.forces(displacement)
        points = list(self.points)
        for contact, passes in sides_of(self._model):
            if contact.points is None:
                for k, pair in quality.more(self.packed, passes, self.points).items():
                    points[k] = pair
        if points == self.points:
            return False
        self.packed, self.points = self._packed(points), points
        return True

    def excess(self, displacement: Array) -> list[tuple[float, str]]:
        """Return, of each contact whose penetration is limited, that over the limit, and both in words."""
        self.forces(displacement)
        found = []
        for k, (contact, points) in enumerate(slave_points(self._model, self.packed)):
            limit, states = self._limit(contact), self.packed.states[points]
            if np.isfinite(limit):
                depth = max(0.0, -float(states["gap"][states["pressure"] > 0.0].min(initial=0.0)))
                found.append((depth / limit, f"contact {k}: penetration {depth:.3g}, wanted {limit:.3g},"))
        return found

    def augment(self, displacement: Array, in_cells: bool) -> None:
        """Make pressures the multipliers of contacts whose penetration is limited, or add to these by cells."""
        self.forces(displacement)
        pressure = self.packed.states["pressure"]
        if in_cells:
            # The first ones are as they come; what is added to them has no shape within a cell.
            former = np.where(pressure > 0.0, self.packed.multipliers, 0.0)
            if former.any():
                pressure = np.maximum(0.0, former + cells.means(self._model, self.packed, pressure - former))
        for contact, points in slave_points(self._model, self.packed):
            if np.isfinite(self._limit(contact)):
                self.packed.multipliers[points] = pressure[points]

    def stiffen(self, times: float) -> None:
        """Raise penalties that nobody gave."""
        for contact, passes in sides_of(self._model):
            if contact.penalty is None:
                self.packed.passes["penalty"][passes.start : passes.stop] *= times

    def _limit(self, contact: Contact) -> float:
        """Return how deep a point of a contact may be."""
        if contact.penetration is not None:
            return contact.penetration
        return np.inf if contact.penalty is not None else _DEEPEST * smallest_radius(self._model, contact)
