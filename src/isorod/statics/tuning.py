"""Numbers that control load steps, contact on the load path, and the line search.

What half and twice a value change is beside it, in linear solves of four cases: `rope`, the scene (85, one load step,
largest pressure 99.0); `pair7` and `pair20`, random pairs of rods (46 and 128; `pair` of `tests/pushed.py`); and
`crossed`, two bars pressed into each other by half a radius (38; `tests/test_contact_statics.py`).  Results agree to
four digits but where another is beside it.
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

    # A limit.
    halvings: int = 10
    quick: int = 4
    # 3, 12: no change.
    quick_touching: int = 6
    # 2, 8: no change.
    wary: int = 4
    # 0.015: `rope` 223 and four cuts; 0.06: 111.
    softer: float = 0.03
    # 1e-3, 4e-3: no change.
    softest: float = 2e-3
    # 2: `pair20` is not settled after 50 updates, `rope` 97; 8: 90 and 81, largest pressure of `rope` 107.5.
    stiffer: float = 4.0
    stiffenings: int = 3
    # 0.25: largest pressure of `rope` 140, since penetration is left to the points; 0.9: `pair20` 153, `pair7` 62.
    stalled: float = 0.5
    # Limits.
    updates: int = 50
    update_halvings: int = 3
    additions: int = 3
    # 0.4: `rope` 196 and two cuts; 0.95: no change beyond one solve.
    kept: float = 0.8
    # 0.05: `rope` 181 and two cuts; 0.2: 174 and two cuts.
    left: float = 0.1
    # A limit.
    evaluations: int = 30
    short: float = 0.01


CONTROL = StepControl()
