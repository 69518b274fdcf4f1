"""Numbers that control load steps, contact on the load path, and the line search.

Linear solves (largest pressure where that changes) are of ``rope``, the scene; of ``pair7`` and ``pair20``, random pairs
of rods (`tests.pushed.pair`); and of ``crossed``, two bars pressed into each other by half a radius.  EVIDENCE
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class StepControl:
    """By how much and how often load steps, penalties and multipliers change.

    Attributes
    ----------
    halvings
        How often a load step is halved at most: a limit, at which the analysis ends.
    quick, quick_touching
        A step doubles after one of at most so many linear solves, without contact and with.
    wary
        With contact, it takes as many such steps more as were cut, at most so many.
    softer, softest
        Factor on penalties after a load step that failed, and the part of their defaults below which they do not fall.
    stiffer, stiffenings
        Factor on penalties where updates of multipliers stall, or, at most, where penalties rise again, and how often
        they rise above their defaults at most.
    stalled
        Part of the penetration that updates leave where they stall.
    updates, update_halvings
        Updates of the multipliers at most, a limit; how often one that fails is halved.
    additions
        How often points are added at most.
    kept, left
        A full Newton step stays where it brings the work of the residual along it down to this part; else the zero is
        bracketed until so little is left.
    evaluations, short
        Residuals of a line search at most, a limit; the part of a step that is hardly one.
    """

    halvings: int = 10
    quick: int = 4
    quick_touching: int = 6
    wary: int = 4
    softer: float = 0.03
    softest: float = 2e-3
    stiffer: float = 4.0
    stiffenings: int = 3
    stalled: float = 0.5
    updates: int = 50
    update_halvings: int = 3
    additions: int = 3
    kept: float = 0.8
    left: float = 0.1
    evaluations: int = 30
    short: float = 0.01


CONTROL = StepControl()
