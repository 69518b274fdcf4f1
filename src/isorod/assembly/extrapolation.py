"""Newton's method with the stress as a variable of its own at the quadrature points.

In a slender body that turns, the quadratic part of a linear step is spurious stretch, hence a large axial stress, hence
a geometric stiffness that spoils the next step.  With stresses as unknowns beside the displacements, eliminated point
by point, the step extrapolates them linearly instead: Newton's iterates differ, their limit does not (Magisano,
Leonetti & Garcea, How to improve efficiency and robustness of the Newton method in geometrically non-linear structural
problems discretized via displacement-based finite elements, Comput. Methods Appl. Mech. Engrg. 313 (2017) 986-1005).

With ``P = F S`` and ``S' = S0 + F0^-1 (A0 : D - D S0)`` of the last state ``F0``, ``D = F - F0``, the tangent is
``A_aAbB + delta_ab (S' - S)_AB`` (`isorod.assembly.block_kernel`).  Only the displacement of the last state is kept.
"""

from typing import NamedTuple

from isorod.arrays import Array
from isorod.geometry.rod import Rod

# Slenderness, length over radius, from which it pays.  A stubby body, strained rather than rotated, takes more
# iterations with it.
SLENDER = 20.0


def pays(rod: Rod) -> bool:
    """Whether extrapolation pays: the rod's length is at least `SLENDER` times the largest radius of its sections."""
    return rod.slenderness >= SLENDER


class Last(NamedTuple):
    """The state of a part at its last tangent.

    Attributes
    ----------
    local
        The rank's degrees of freedom.
    pressure
        That of the mixed formulation at the quadrature points ``(E, t, q)``, or an empty array.
    """

    local: Array
    pressure: Array
