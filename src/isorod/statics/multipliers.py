"""Contact at a load: multipliers until it is as tight as asked for, and points until its patches are seen.

Uzawa's updates make the pressures of a solution the multipliers of the next.  The first ones are those of the plain
penalty; what is added to them is then the same all over a cell (`isorod.contact.cells`), which leaves the surfaces as
free as they are able to move: multipliers of points, of which there are more, take away the gap of each and make of the
pressure the fewer and higher peaks the more often they are updated.  Only where penetration stays too deep, since
control points are far apart, or more is asked for than such surfaces can do, pressures at points follow, and where
these stall a stiffer penalty.
"""

import warnings
from typing import TYPE_CHECKING

import numpy as np

from isorod.arrays import Array
from isorod.errors import SolveError
from isorod.statics.newton import Newton
from isorod.statics.steps import Diverged

if TYPE_CHECKING:
    from isorod.contact.operator import ContactOperator
    from isorod.contact.result import ContactResult

# Multipliers are updated at most this many times, points added to at most this many times.
AUGMENTATIONS = 50
_RAISES = 3

# Updates stall where they leave more than this share of the penetration; then the penalty is raised by this factor, at
# most so many times.
_STALLED, _STIFFER, _TIMES = 0.5, 4.0, 3

# An update is halved at most so many times.
_HALVINGS = 3


def settle(solver: Newton, factor: float) -> int:
    """Settle contact at a load factor; return how many updates of multipliers that took.

    Raises
    ------
    Diverged
        If there is no equilibrium with more points, or other multipliers.
    SolveError
        If penetration does not fall to what is asked for.
    """
    contact = solver.assembler.contact
    assert contact is not None
    _harden(solver, factor, contact)
    for _ in range(_RAISES):
        if not contact.see_better(_displacement(solver, factor), between=factor == 1.0):
            break
        _advance(solver, factor, "more points of contact")
    return _at_points(solver, factor, contact, _in_cells(solver, factor, contact, 0))


def _harden(solver: Newton, factor: float, contact: "ContactOperator") -> None:
    """Raise penalties that fell on the way to what they were, or as far as there is an equilibrium.

    Multipliers of a penalty that is too soft take the patch for what that made of it.
    """
    if not contact.is_soft:
        return
    rises = int(np.ceil(np.log(1.0 / contact.stiffness) / np.log(_STIFFER)))
    times = (1.0 / contact.stiffness) ** (1.0 / rises)
    for _ in range(rises):
        contact.stiffen(times)
        try:
            solver.advance(factor, factor)
        except Diverged:
            contact.stiffen(1.0 / times)
            return


def outcome(contact: "ContactOperator", displacement: Array) -> "list[ContactResult]":
    """Return the outcome of each contact, and warn of what is not to be trusted.

    Whoever gives penalty and points has said what the contact is.
    """
    results = contact.results(displacement, check=True)
    for k, (asked, result) in enumerate(zip(contact.model.contacts, results, strict=True)):
        doubt = result.doubt()
        if doubt is not None and (asked.penalty is None or asked.points is None):
            warnings.warn(f"contact {k}: {doubt}", stacklevel=5)
    return results


def _displacement(solver: Newton, factor: float) -> Array:
    return solver.assembler.displacement(solver.x, factor)


def _advance(solver: Newton, factor: float, what: str) -> None:
    try:
        solver.advance(factor, factor)
    except Diverged as problem:
        raise Diverged(f"{what}: {problem}") from None


def _deepest(solver: Newton, factor: float, contact: "ContactOperator") -> tuple[float, str]:
    """Return the largest penetration over its limit, and in words."""
    return max(contact.excess(_displacement(solver, factor)), default=(0.0, ""))


def _update(solver: Newton, factor: float, contact: "ContactOperator", in_cells: bool) -> Diverged | None:
    """Update multipliers and find the equilibrium; by half as much each time that fails, and in the end not at all."""
    before = contact.packed.multipliers.copy()
    contact.augment(_displacement(solver, factor), in_cells)
    change = contact.packed.multipliers - before
    for halvings in range(_HALVINGS + 1):
        contact.packed.multipliers[:] = before + 0.5**halvings * change
        try:
            solver.advance(factor, factor)
        except Diverged as why:
            problem = why
        else:
            return None
    contact.packed.multipliers[:] = before
    return problem


def _in_cells(solver: Newton, factor: float, contact: "ContactOperator", count: int) -> int:
    """Update multipliers by cells until that does no more; return how many updates there are now.

    A small patch may be less deep than the limit, and give way all the same.
    """
    last = np.inf
    while count < AUGMENTATIONS:
        depth, _ = _deepest(solver, factor, contact)
        if depth > _STALLED * last or depth <= 0.0:
            break
        problem = _update(solver, factor, contact, in_cells=True)
        if problem is not None and depth <= 1.0:
            break
        if problem is not None:
            raise Diverged(f"augmented Lagrangian, update {count + 1}: {problem}")
        count, last = count + 1, depth
    return count


def _at_points(solver: Newton, factor: float, contact: "ContactOperator", count: int) -> int:
    """Update multipliers at points until all is tight; return how many updates there are now."""
    last, raised = np.inf, 0
    while True:
        depth, said = _deepest(solver, factor, contact)
        if depth <= 1.0:
            return count
        if count >= AUGMENTATIONS:
            raise SolveError(f"{said} after {AUGMENTATIONS} updates of the multipliers; raise the penalty")
        if depth > _STALLED * last and raised < _TIMES:
            contact.stiffen(_STIFFER)
            raised += 1
        problem = _update(solver, factor, contact, in_cells=False)
        if problem is not None:
            raise Diverged(f"augmented Lagrangian, update {count + 1}: {problem}")
        count, last = count + 1, depth
