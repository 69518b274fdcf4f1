"""Penalties fall where a load step fails, and rise again where bodies get too deep into each other."""

from types import SimpleNamespace

import pytest

from isorod.errors import SolveError
from isorod.statics import analysis
from isorod.statics.newton import Diverged, TooDeep


class Springs:
    """Contact that knows no more than how stiff it is."""

    friction = None

    def __init__(self):
        self.stiffness = 1.0

    may_soften = property(lambda self: self.stiffness > 2e-3)
    is_soft = property(lambda self: self.stiffness < 0.5)

    def stiffen(self, times):
        self.stiffness *= times


def climb(monkeypatch, outcome):
    """Climb by steps whose outcome ``(stiffness, length) -> error or None`` is told; return steps, cuts, all tried."""
    contact, taken = Springs(), []

    def advance(factor, target):
        taken.append((round(contact.stiffness, 6), target - factor))
        problem = outcome(contact.stiffness, target - factor)
        if problem is not None:
            raise problem("said")
        return 9

    model = SimpleNamespace(stages=[1.0])
    solver = SimpleNamespace(
        assembler=SimpleNamespace(contact=contact, model=model),
        advance=advance,
        forget_path=lambda: None,
        settle=lambda: None,
    )
    monkeypatch.setattr(analysis, "settle", lambda solver, factor: 0)
    monkeypatch.setattr(analysis, "_reached", lambda solver, factor: factor)
    path = []
    cuts, _ = analysis._climb(solver, 1, path)
    return len(path), cuts, taken


def test_a_step_that_fails_is_tried_with_lower_penalties_before_it_is_cut(monkeypatch):
    steps, cuts, taken = climb(monkeypatch, lambda stiffness, length: Diverged if stiffness > 2e-3 else None)
    assert (steps, cuts) == (1, 0)
    assert taken == [(1.0, 1.0), (0.03, 1.0), (0.0009, 1.0)]


def test_penalties_that_are_too_low_rise_and_the_step_is_cut(monkeypatch):
    def outcome(stiffness, length):
        if length > 0.5:
            return Diverged if stiffness > 0.5 else TooDeep
        return None

    steps, cuts, taken = climb(monkeypatch, outcome)
    assert (steps, cuts) == (2, 1)
    assert taken == [(1.0, 1.0), (0.03, 1.0), (1.0, 0.5), (1.0, 0.5)]


@pytest.mark.parametrize("problem", [Diverged, TooDeep])
def test_what_never_works_ends_in_one_line(monkeypatch, problem):
    with pytest.raises(SolveError, match=r"load factor .*: said"):
        climb(monkeypatch, lambda stiffness, length: problem)
