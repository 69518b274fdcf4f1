"""Numbering of unknowns: degrees of freedom that supports neither hold nor tie, and one for those tied together.

The displacement of a held degree of freedom is prescribed.  Tied ones have one common unknown, the displacement of the
first of them, to which the rotation adds their differences.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from isorod.arrays import Index
from isorod.errors import InputError
from isorod.model.motion import SupportMotion

# Load factors at which the displacements of two supports on one degree of freedom are compared.
_SAMPLES = (1.0, 0.73, 0.37, 0.11)


class Numbering(NamedTuple):
    """Degrees of freedom that are ``held``, and ``bound``, held or tied, by support ``support_of``.

    ``free`` maps each degree of freedom to its unknown or -1.
    """

    held: Index
    bound: Index
    support_of: Index
    free: Index


def number(motions: Sequence[SupportMotion], dofs: int) -> Numbering:
    """Return the numbering of ``dofs`` degrees of freedom under the supports' motions.

    Raises
    ------
    InputError
        If two supports contradict each other.
    """
    owner = np.full(dofs, -1)
    tied = np.zeros(dofs, dtype=bool)
    leader = np.arange(dofs)
    supported = np.concatenate([owner[:0], *(motion.dofs for motion in motions)])
    # Displacements by supports, if some degrees of freedom belong to several.
    values = np.full((len(_SAMPLES), dofs), np.nan) if np.bincount(supported).max(initial=0) > 1 else None
    for k, motion in enumerate(motions):
        if values is not None:
            prescribed = np.stack([motion.at(factor) for factor in _SAMPLES])
            before = owner[motion.dofs] >= 0
            differs = (values[:, motion.dofs] != prescribed).any(axis=0)
            clash = before & (differs | tied[motion.dofs] | motion.tied)
            if clash.any():
                dof = motion.dofs[np.argmax(clash)]
                raise InputError(
                    f"support {k}: node {dof // 3}, component {'xyz'[dof % 3]} is prescribed by another support "
                    "with another displacement"
                )
            values[:, motion.dofs] = prescribed
        owner[motion.dofs] = k
        if motion.tied.any():
            for a in range(3):
                together = motion.dofs[motion.tied & (motion.dofs % 3 == a)]
                leader[together] = together.min(initial=dofs)
                tied[together] = True
    bound = owner >= 0
    held = bound & ~tied
    leads = ~held & (leader == np.arange(dofs))
    free = np.where(held, -1, (np.cumsum(leads) - 1)[leader])
    return Numbering(np.flatnonzero(held), np.flatnonzero(bound), owner[bound], free)
