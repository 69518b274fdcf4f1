"""Numbers that control load steps, contact on the load path, and the line search.

Comments give the effect of half and twice a value, in linear solves of four cases: `rope`, the scene (85, one load
step, largest pressure 99.0); `pair7` and `pair20`, random pairs of rods (46 and 128; `pair` of `tests/pushed.py`); and
`crossed`, two bars pressed into each other by half a radius (38; `tests/test_contact_statics.py`).  Results agree to
four digits unless another one is given.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class StepControl:
    """Control of changes of load steps, penalties and multipliers.

    Attributes
    ----------
    halvings
        Maximum number of halvings of a load step, after which the analysis ends.
    quick, quick_touching
        Maximum number of linear solves of a quick step, without contact and with; the next step is twice as long.
    wary
        With contact, as many more quick steps are needed for that as steps were cut, at most so many.
    softer, softest
        Factor on penalties after a load step that failed, and smallest fraction of their defaults.
    stiffer, stiffenings
        Factor on penalties where updates of multipliers stall, and largest one where reduced penalties rise again;
        maximum number of rises above their defaults.
    stalled
        Fraction of the penetration left by an update above which updates stall.
    updates, update_halvings
        Maximum number of multiplier updates, and of halvings of one that fails.
    additions
        Maximum number of additions of points.
    kept, left
        A full Newton step is accepted where the work of the residual along it falls to this fraction; otherwise the
        zero is bracketed to this fraction.
    evaluations, short
        Maximum number of residuals of a line search; fraction of a step that counts as very short.
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
