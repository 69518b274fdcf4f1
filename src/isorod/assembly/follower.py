"""Follower loads, which depend on the state: pressure on a surface, and moments (`isorod.assembly.section_moment`).

Of pressure ``f_jl = -p int S_l R_j (dx/dtheta x dx/du) dtheta du`` with the present position ``x`` of the surface.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.assembly.partition import ElementRange
from isorod.assembly.section_moment import SectionMoment
from isorod.model.load import Pressure, SectionLoad

# Permutation symbol: ``(a x b)_i = _CROSS[i, j, k] a_j b_k``.
_CROSS = np.zeros((3, 3, 3))
for _a, _b, _c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _CROSS[_a, _b, _c], _CROSS[_a, _c, _b] = 1.0, -1.0


class Surface(NamedTuple):
    """Functions at the points of a surface, as in `isorod.space.space.Table`, and the pressure times the weights.

    ``values`` and ``around`` ``(q, n)`` are those of the section and their derivatives by the angle, ``axial`` and
    ``slopes`` ``(E, t, l)`` those along the axis, ``weights`` ``(E, t, q)``.
    """

    values: Array
    around: Array
    axial: Array
    slopes: Array
    weights: Array


class FollowerLoads:
    """The loads that depend on the state, on the elements of one body that a rank assembles.

    Parameters
    ----------
    element_range
        Which elements they are.
    loads
        Follower pressures and moments on that body.
    """

    def __init__(self, element_range: ElementRange, loads: Sequence[Pressure | SectionLoad]) -> None:
        space = element_range.body.space
        # The present factor of each load.
        self._loads, self._factors = loads, [1.0] * len(loads)
        nodes = space.element_nodes[element_range.first : element_range.last]
        shape = (*element_range.layers.shape, space.layer_nodes, 3)
        self._positions = space.positions[nodes].reshape(shape)
        moments = [
            (k, SectionMoment(element_range, load)) for k, load in enumerate(loads) if isinstance(load, SectionLoad)
        ]
        self._twisting = bool(moments)
        self._moments = [(k, one) for k, one in moments if one.element >= 0]
        self._surfaces = []
        for k, load in enumerate(loads):
            if isinstance(load, SectionLoad):
                continue
            xi, u, weights = load.points(space)
            values, gradients = space.basis.functions(xi)
            own = u[element_range.first : element_range.last]
            _, axial, slopes = space.axis.local(own.ravel())
            surface = Surface(
                values,
                gradients[:, :, 1] * xi[:, :1] - gradients[:, :, 0] * xi[:, 1:],
                axial.reshape(*own.shape, -1),
                slopes.reshape(*own.shape, -1),
                weights[element_range.first : element_range.last],
            )
            self._surfaces.append((k, surface))

    def at(self, begin: float, end: float) -> None:
        """Set the loads to their means over a time interval, or their values at one time."""
        self._factors = [load.factor(begin, end) for load in self._loads]

    def reach(self, amplitude: Callable[[Pressure | SectionLoad], float]) -> None:
        """Set the factor of each load."""
        self._factors = [amplitude(load) for load in self._loads]

    def _tangents(self, s: Surface, nodal: Array) -> tuple[Array, Array]:
        """Return ``dx/dtheta`` and ``dx/du``, shape ``(E, t, q, 3)``."""
        places = self._positions + nodal
        around = np.einsum("etj,qn,ejna->etqa", s.axial, s.around, places, optimize=True)
        return around, np.einsum("etj,qn,ejna->etqa", s.slopes, s.values, places, optimize=True)

    def forces(self, nodal: Array) -> Array:
        """Return the forces with the present factors, shape of the nodal displacements ``(E, l, n, 3)``."""
        result = np.zeros(nodal.shape)
        for k, s in self._surfaces:
            pull = self._factors[k] * s.weights[..., None] * np.cross(*self._tangents(s, nodal))
            result += np.einsum("etj,qn,etqa->ejna", s.axial, s.values, pull, optimize=True)
        for k, moment in self._moments:
            forces = moment.forces(self._places(moment, nodal)).reshape(nodal.shape[1:])
            result[moment.element] += self._factors[k] * forces
        return result

    def _places(self, moment: SectionMoment, nodal: Array) -> Array:
        """Return the present positions of the nodes of a moment's element."""
        return (self._positions[moment.element] + nodal[moment.element]).reshape(-1, 3)

    def stiffness(self, nodal: Array) -> Array:
        """Return the derivatives of the forces, without moments made symmetric, shape ``(E, l n 3, l n 3)``.

        Those of pressures are symmetric except for terms along the surface's edges at free ends, which Newton's method
        does not need.
        """
        result = self.derivatives(nodal)
        if self._twisting:
            return result
        return 0.5 * (result + np.swapaxes(result, 1, 2))

    def derivatives(self, nodal: Array) -> Array:
        """Return the derivatives of the forces, shape ``(E, l n 3, l n 3)``."""
        size = nodal[0].size
        result = np.zeros((nodal.shape[0], size, size))
        for k, s in self._surfaces:
            around, along = (self._factors[k] * s.weights[..., None] * one for one in self._tangents(s, nodal))
            by_around = np.einsum("qn,qk,abc,etqc->etnkab", s.values, s.around, _CROSS, along, optimize=True)
            by_along = np.einsum("qn,qk,acb,etqc->etnkab", s.values, s.values, _CROSS, around, optimize=True)
            whole = np.einsum("etj,etm,etnkab->ejnamkb", s.axial, s.axial, by_around, optimize=True)
            whole += np.einsum("etj,etm,etnkab->ejnamkb", s.axial, s.slopes, by_along, optimize=True)
            result += whole.reshape(result.shape)
        for k, one in self._moments:
            result[one.element] += self._factors[k] * one.derivatives(self._places(one, nodal))
        return result
