"""Compiled: control points of surfaces whose spaces have none there (`isorod.contact.traces`), and their forces."""

from numba import void

from isorod.arrays import Array
from isorod.compiled import F2, FAST, njit
from isorod.contact.packed import PACKED, Packed


@njit(void(PACKED, F2), **FAST)
def lift(packed: Packed, positions: Array) -> None:
    """Fill the positions of control points, which stand after those of the model's own nodes."""
    for k in range(packed.lifts.size):
        one = packed.lifts[k]
        for layer in range(one.layers):
            node, own = one.first_point + layer * one.around, one.first_node + layer * one.functions
            for i in range(one.around):
                for a in range(3):
                    value = 0.0
                    for f in range(one.functions):
                        value += packed.matrices[one.first_value + i * one.functions + f] * positions[own + f, a]
                    positions[node + i, a] = value


@njit(void(PACKED, F2), **FAST)
def lower(packed: Packed, forces: Array) -> None:
    """Add the forces on control points to those on the model's own nodes, and take them away there."""
    for k in range(packed.lifts.size):
        one = packed.lifts[k]
        for layer in range(one.layers):
            node, own = one.first_point + layer * one.around, one.first_node + layer * one.functions
            for i in range(one.around):
                x, y, z = forces[node + i, 0], forces[node + i, 1], forces[node + i, 2]
                if x == 0.0 and y == 0.0 and z == 0.0:
                    continue
                for f in range(one.functions):
                    share = packed.matrices[one.first_value + i * one.functions + f]
                    forces[own + f, 0] += share * x
                    forces[own + f, 1] += share * y
                    forces[own + f, 2] += share * z
                for a in range(3):
                    forces[node + i, a] = 0.0
