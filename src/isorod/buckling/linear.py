"""Load factors of the pencil of one equilibrium: ``K x = -mu K' x``, the factor being ``mu`` more than there.

With ``nu = -1 / mu`` it is ``K' x = nu K x``, that of modes with a definite matrix in the place of the mass: the least
``mu`` above zero is the lowest ``nu``, by shift-and-invert, and the same Sturm count proves that none is missed.  The
shift is the ``nu`` of a load below all, where ``K + mu K'``, which is factorised, is definite.
"""

import numpy as np

from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation
from isorod.buckling.tangents import Tangents
from isorod.errors import InputError
from isorod.modal.pencil import Found, Pencil
from isorod.petsc.softest import noise

# Iterations that guess the size of the least factor.
_ITERATIONS = 6

# Load factors farther than so many times the first guess are none.
_FARTHEST = 1e6


def linear(assembler: Assembler, tangents: Tangents, wanted: int) -> Found:
    """Return the pairs of the ``wanted`` least ``mu`` above zero, fewer where there are not as many.

    Their eigenvalues are ``nu = -1 / mu``.  ``K`` must be definite.

    Raises
    ------
    InputError
        If the load takes no stiffness away, however large it is.
    SolveError
        If SLEPc does not converge, or a Sturm count shows that one is missing.
    """
    pencil = Pencil(tangents.derivative, tangents.stiffness, factors=factorisation(assembler, "st_"))
    first = guess = _size(tangents)
    while pencil.count_below(-1.0 / guess):
        guess *= 0.5
    while not pencil.count_below(-1.0 / (2.0 * guess)):
        guess *= 2.0
        if not guess < _FARTHEST * first:
            raise InputError(
                "buckling: the loads never make the tangent stiffness singular; do they pull where they should push?"
            )
    return pencil.solve(min(wanted, pencil.count_below(-1.0 / (_FARTHEST * guess)), pencil.size), -1.0 / guess)


def _size(tangents: Tangents) -> float:
    """Return about how large the ``mu`` nearest to zero is, of either sign."""
    shape, push = noise(tangents.rate), tangents.rate.duplicate()
    size = np.inf
    for _ in range(_ITERATIONS):
        tangents.derivative.mult(shape, push)
        follows = tangents.solve(push)
        size = shape.norm() / follows.norm() if follows.norm() else np.inf
        follows.normalize()
        follows.copy(shape)
    if not np.isfinite(size):
        raise InputError("buckling: the tangent stiffness does not change with the loads; is there one?")
    return float(size)
