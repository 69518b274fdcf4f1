"""Compiled: control points of surfaces whose spaces have none (`isorod.contact.traces`), and their forces."""

from numba import void

from isorod.arrays import Array
from isorod.compiled import F2, FAST, njit
from isorod.contact.packed import PACKED, Packed


@njit(void(PACKED, F2), **FAST)
def lift(packed: Packed, positions: Array) -> None:
    """Fill the positions of control points, which come after those of the model's own nodes."""
    for k in range(packed.lifts.size):
        row = packed.lifts[k]
        for layer in range(row.layers):
            node, own = row.first_point + layer * row.around, row.first_node + layer * row.functions
            for i in range(row.around):
                for a in range(3):
                    value = 0.0
                    for f in range(row.functions):
                        value += packed.matrices[row.first_value + i * row.functions + f] * positions[own + f, a]
                    positions[node + i, a] = value


@njit(void(PACKED, F2), **FAST)
def lower(packed: Packed, forces: Array) -> None:
    """Move the forces on control points to the model's own nodes."""
    for k in range(packed.lifts.size):
        row = packed.lifts[k]
        for layer in range(row.layers):
            node, own = row.first_point + layer * row.around, row.first_node + layer * row.functions
            for i in range(row.around):
                x, y, z = forces[node + i, 0], forces[node + i, 1], forces[node + i, 2]
                if x == 0.0 and y == 0.0 and z == 0.0:
                    continue
                for f in range(row.functions):
                    coefficient = packed.matrices[row.first_value + i * row.functions + f]
                    forces[own + f, 0] += coefficient * x
                    forces[own + f, 1] += coefficient * y
                    forces[own + f, 2] += coefficient * z
                for a in range(3):
                    forces[node + i, a] = 0.0
