"""Loose overhand knot in a thin, inextensible, untwisted rod, without friction.

The limit in which the rod's radius is small beside the loop's.  Then the loop is a circle that the rod enters and
leaves along the same tangent, that of the straight tails, and all contact is in a braid short beside the loop.  With
bending stiffness B, tension T in the tails and loop radius R:

- a circle has the energy ``pi B/R`` and takes ``2 pi R`` from the tails' length: their sum with T is least where
  ``T = B/(2 R^2)``;
- the same follows along the rod: where contact is frictionless, ``tension + B kappa^2/2`` is the same everywhere, T in
  the straight tails, ``B/(2 R^2)`` in the circle, which carries no force, by Kirchhoff's equations of a circle.

What is left out is of the order of ``sqrt(radius/R)``, the braid's length over the loop's: extrapolate in that.  The
contact forces are of the order of B/R over the braid's length, so that friction is not small: it changes T by the order
of ``mu sqrt(R/radius)``.  The braid is solved in B. Audoly, N. Clauvelin, S. Neukirch, Elastic knots, Phys. Rev. Lett.
99 (2007) 164301, and by the same, Matched asymptotic expansions for twisted elastic knots, arXiv:0812.2881.
"""


def tension(bending: float, loop_radius: float) -> float:
    """Return the force that pulls the tails of a loose knot, ``B/(2 R^2)``; bending stiffness in force x length^2."""
    return bending / (2.0 * loop_radius**2)
