"""The mixed formulation: displacement and pressure, free of locking near incompressibility.

Stationary point of ``integral of psi(F) + p theta(F) - U*(p)`` (Herrmann, AIAA J. 3 (1965) 1896-1900; Simo, Taylor &
Pister, CMAME 51 (1985) 177-208), where a law is ``W = psi + U(theta)``, ``U*`` Legendre's transform of ``U``, and
``theta = ln J`` or, linear, ``tr e``; of ``kappa/2 theta^2`` it is ``p^2 / (2 kappa)``.  The pressure, positive in
tension, is ``p = U'(theta)`` in the mean; ``kappa`` may be infinite, and ``theta`` is then zero in the mean.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly import element_kernel
from isorod.assembly.assembler import Assembler
from isorod.assembly.exchange import Exchange
from isorod.assembly.gradients import deformation_gradients, pulled_stress
from isorod.assembly.part import Part
from isorod.assembly.partition import ElementRange
from isorod.assembly.pattern import add
from isorod.assembly.pattern_kernel import Blocks
from isorod.material.along_rod import complementary, shear_laws, volume_change
from isorod.model.body import Body
from isorod.space.space import Table

# Elements whose pressure matrices are evaluated at a time.
_SOME = 64


class MixedPart(Part):
    """The elements of one mixed body; a layer holds its displacements, then its pressures."""

    def __init__(self, element_range: ElementRange, exchange: Exchange) -> None:
        super().__init__(element_range, exchange)
        body = element_range.body
        assert body.pressures is not None
        self.moves = 3 * body.space.layer_nodes
        self.across, self.along = body.pressures.tabulate(self.table)
        self.across *= body.pressure_unit
        self.volumes, self.laws = self.laws, shear_laws(self.laws)

    def pressure(self, local: Array) -> Array:
        """Return the pressure at the quadrature points, shape ``(E, t, q)``."""
        near = local[self.slots].reshape(*self.layers.shape, -1)[:, :-1, self.moves :]
        return np.ascontiguousarray(np.einsum("etj,ejk->etk", self.along, near) @ self.across.T)

    def energy(self, local: Array, factor: float) -> float:
        """Return the value of the functional: at a solution, the stored energy."""
        F, p = self.gradients(local), self.pressure(local)
        density = self.laws.at(factor).energy(F) + p * volume_change(self.volumes, F)[0]
        density -= complementary(self.volumes.at(factor), p)[0]
        return float(np.sum(self.table.weights * density))

    def add_forces(self, local: Array, factor: float, forces: Array) -> None:
        """Add the derivatives by displacements and pressures."""
        super().add_forces(local, factor, forces)
        theta = volume_change(self.volumes, self.gradients(local))[0]
        self.add_volumes(theta - complementary(self.volumes.at(factor), self.pressure(local))[1], forces)

    def add_volumes(self, values: Array, forces: Array) -> None:
        """Add the integrals of values at the points ``(E, t, q)`` times the functions of the pressures."""
        across = (self.table.weights * values) @ self.across
        slots = self.starts[:, :-1, None] + np.arange(self.moves, self.width)
        forces += np.bincount(slots.ravel(), np.einsum("etj,etk->ejk", self.along, across).ravel(), forces.size)

    def matrices(self, local: Array, factor: float, which: Index | None = None) -> Array:
        """Return the second derivatives, shape ``(E, l width, l width)``, or those of some elements."""
        some = np.arange(self.layers.shape[0]) if which is None else which
        result = self._coupling(some, self.nodal(local)[some], self.pressure(local)[some], factor)
        result += super().matrices(local, factor, which)
        return result

    def add_entries(self, local: Array, factor: float, blocks: Blocks, entries: Array) -> None:
        """Add the second derivatives to entries of a pattern."""
        super().add_entries(local, factor, blocks, entries)
        nodal, p = self.nodal(local), self.pressure(local)
        for first in range(0, nodal.shape[0], _SOME):
            some = np.arange(first, min(first + _SOME, nodal.shape[0]))
            add(self._coupling(some, nodal[some], p[some], factor), blocks, entries, some)

    def _coupling(self, which: Index, nodal: Array, p: Array, factor: float) -> Array:
        """Return the second derivatives of some elements, without those by displacements alone."""
        t, laws = self.table.part(which, slice(None)), self.volumes.some(which).at(factor)
        slope = volume_change(laws, deformation_gradients(t, nodal))[1]
        both = coupling(t, slope, self.across, self.along[which])
        elements, layers = nodal.shape[0], self.layers.shape[1]
        result = np.zeros((elements, layers, self.width, layers, self.width))
        self.set_coupling(result, both, both, self.own(which, complementary(laws, p)[2]))
        return result.reshape(elements, layers * self.width, -1)

    def own(self, which: Index | slice, compliance: Array) -> Array:
        """Return the second derivatives of some elements by pressures, shape ``(e, l - 1, m, l - 1, m)``."""
        values = np.ascontiguousarray(np.repeat(self.across[:, None, :], 3, axis=1))
        return element_kernel.mass(values, self.along[which], -compliance * self.table.weights[which])

    def set_coupling(self, result: Array, right: Array, below: Array, own: Array) -> None:
        """Set the pressure columns, pressure rows and their common block of matrices ``(e, l, width, l, width)``.

        The first two are as `coupling` returns them.
        """
        elements, layers, moves = result.shape[0], result.shape[1], self.moves
        shape = elements, layers, moves, layers - 1, self.width - moves
        result[:, :, :moves, :-1, moves:] = right.reshape(shape)
        result[:, :-1, moves:, :, :moves] = below.reshape(shape).transpose(0, 3, 4, 1, 2)
        result[:, :-1, moves:, :-1, moves:] = own

    def padded(self, nodal: Array) -> Array:
        """Return nodal forces with zeros for the pressures, shape of ``dofs``."""
        result = np.zeros((*self.layers.shape, self.width))
        result[:, :, : self.moves] = nodal.reshape(*self.layers.shape, -1)
        return result.reshape(self.dofs.shape)

    def padded_matrices(self, matrices: Array) -> Array:
        """Return matrices of displacements with room for pressures, shape ``(E, l, width, l, width)``."""
        elements, layers = self.layers.shape
        result = np.zeros((elements, layers, self.width, layers, self.width))
        result[:, :, : self.moves, :, : self.moves] = matrices.reshape(elements, layers, self.moves, layers, self.moves)
        return result


def coupling(table: Table, slope: Array, across: Array, along: Array) -> Array:
    """Return the matrices ``(E, l, n, 3, l - 1, m)`` of displacements and pressures.

    ``slope`` ``(E, t, q, 3, 3)`` is ``d theta / dF``; ``across`` ``(q, m)`` and ``along`` ``(E, t, l - 1)`` are the
    pressure functions.
    """
    elements, places, functions = table.axial.shape
    n, pressures = table.section.shape[2], across.shape[1]
    # Products of section functions, differentiated across or not, with pressure functions.
    products = [table.section[:, d, :, None] * across[:, None] for d in range(3)]
    products = [np.concatenate(products[:2]), products[2]]
    result = np.zeros((elements, functions * (functions - 1), 3 * n * pressures))
    for values, stress, one in zip((table.axial, table.slopes), pulled_stress(table, slope), products, strict=True):
        pairs = np.einsum("etj,etm->ejmt", values, along).reshape(elements, -1, places)
        result += pairs @ (stress @ one.reshape(len(one), -1)).reshape(elements, places, -1)
    whole = result.reshape(elements, functions, functions - 1, 3, n, pressures)
    return np.ascontiguousarray(whole.transpose(0, 1, 4, 3, 2, 5))


class MixedAssembler(Assembler):
    """Assembles a model some of whose bodies have the mixed formulation: their tangent is indefinite."""

    formulations = ("displacement", "mixed")

    def _part(self, element_range: ElementRange) -> Part:
        kind = Part if element_range.body.pressures is None else MixedPart
        return kind(element_range, self._exchange)

    @staticmethod
    def layer_dofs(body: Body) -> int:
        """Return the number of degrees of freedom of a layer."""
        return 3 * body.space.layer_nodes + (body.pressures.count if body.pressures is not None else 0)

    def _number(self) -> None:
        """Number displacements and pressures, layer by layer."""
        model = self.model
        super()._number()
        first, labels, count = [0], [], model.unknowns
        for b, body in enumerate(model.bodies):
            own = model.free[3 * model.first_node[b] : 3 * model.first_node[b + 1]].reshape(body.space.layers, -1)
            pressures = np.full((own.shape[0], self.layer_dofs(body) - own.shape[1]), -1)
            if body.pressures is not None:
                pressures[: body.pressures.layers] = count + np.arange(body.pressures.size).reshape(
                    -1, body.pressures.count
                )
                count += body.pressures.size
            labels.append(np.concatenate([own, pressures], axis=1).ravel())
            first.append(first[-1] + labels[-1].size)
        label = np.concatenate(labels)
        # Unknowns in the order of first appearance: a layer's pressures follow its displacements, which keeps the
        # band narrow.
        _, appears = np.unique(label[label >= 0], return_index=True)
        self._number_of = np.empty(count, dtype=np.int64)
        self._number_of[np.argsort(appears)] = np.arange(count)
        self.free = np.where(label >= 0, self._number_of[label], -1)
        self.unknowns = count
        self.first = np.array(first, dtype=np.int64)
        self.block = 1

    def _unknowns(self, displacement: Array, pressures: Sequence[Array | None]) -> Array:
        result = np.zeros(self.unknowns)
        first = self.model.unknowns
        result[self._number_of[:first]] = super()._unknowns(displacement, ())
        for body, given in zip(self.model.bodies, pressures, strict=bool(pressures)):
            if given is not None:
                result[self._number_of[first : first + given.size]] = given.ravel() / body.pressure_unit
                first += given.size
        return result

    def _displacements(self, unknowns: Any) -> Any:
        return unknowns[..., self._number_of[: self.model.unknowns]]

    def pressures(self, x: PETSc.Vec) -> list[Array | None]:
        """Return each body's coefficients of its `isorod.space.pressure.Pressures`, force per area, or None."""
        unknowns = self.all_unknowns(x)[self._number_of]
        result: list[Array | None] = []
        first = self.model.unknowns
        for body in self.model.bodies:
            if body.pressures is None:
                result.append(None)
                continue
            mine = unknowns[first : first + body.pressures.size]
            result.append(body.pressure_unit * mine.reshape(-1, body.pressures.count))
            first += body.pressures.size
        return result
