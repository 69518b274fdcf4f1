"""Penalties fall where a load step fails, and rise again where bodies get too deep into each other."""

from types import SimpleNamespace

import numpy as np
import pytest

from isorod.errors import SolveError
from isorod.statics import climb as climbing
from isorod.statics.contact_policy import ContactPolicy
from isorod.statics.steps import Diverged, TooDeep


class Springs:
    """Contact that knows no more than how stiff it is."""

    friction = None
    has_defaults = True
    model = SimpleNamespace(times=None)
    points, ahead = (), None

    def __init__(self):
        self.stiffness = 1.0

    def stiffen(self, times):
        self.stiffness *= times

    def settled(self):
        return SimpleNamespace(penalties=None)


class Rubbing(Springs):
    """Contact with friction, which tells how often it was put back to the start of a step."""

    friction = "some"
    undone = 0

    def place(self, factor):
        pass

    def accept(self, displacement):
        pass

    def undo(self):
        self.undone += 1

    def keep(self):
        return self.undo


class Place:
    """A state that tells where it is."""

    def __init__(self, at=0.0):
        self.at = at

    def copy(self, other=None):
        if other is None:
            return Place(self.at)
        other.at = self.at
        return other


MODEL = SimpleNamespace(stages=[1.0], times=None, remembers=False, when="load factor {:.6g}".format)


def climb(outcome, contact=None, settle=lambda factor: 0, watched=False):
    """Climb by steps whose outcome ``(stiffness, length) -> error or None`` is told; return steps, cuts, all tried."""
    contact, taken, x = Springs() if contact is None else contact, [], Place()

    def advance(factor, target):
        taken.append((round(contact.stiffness, 6), target - factor))
        problem = outcome(contact.stiffness, target - factor)
        if problem is not None:
            raise problem("said")
        assert x.at == factor
        x.at = target
        return 9

    solver = SimpleNamespace(
        steps=SimpleNamespace(turning=SimpleNamespace(longest_step=lambda factor: 1.0), watched=watched, careful=False),
        assembler=SimpleNamespace(
            contact=contact, model=MODEL, touching=lambda x, factor: x, displacement=lambda x, factor: x
        ),
        x=x,
        advance=advance,
        forget_path=lambda: None,
        settle=lambda: None,
        stabilisation=None,
        guess=None,
        cuts=0,
    )
    solver.policy = ContactPolicy(solver, contact)
    solver.policy.settle = settle
    steps = []
    path = SimpleNamespace(reached=lambda x, factor: steps.append(factor), left=lambda x, factor: None, outputs=[])
    climbing.climb(solver, 1, path)
    return len(steps), solver.cuts, taken


def test_a_step_that_fails_is_tried_with_lower_penalties_before_it_is_cut():
    steps, cuts, taken = climb(lambda stiffness, length: Diverged if stiffness > 2e-3 else None)
    assert (steps, cuts) == (1, 0)
    assert taken == [(1.0, 1.0), (0.03, 1.0), (0.0009, 1.0)]


def test_penalties_that_are_too_low_rise_and_the_step_is_cut():
    def outcome(stiffness, length):
        if length > 0.5:
            return Diverged if stiffness > 0.5 else TooDeep
        return None

    steps, cuts, taken = climb(outcome)
    assert (steps, cuts) == (2, 1)
    assert taken == [(1.0, 1.0), (0.03, 1.0), (1.0, 0.5), (1.0, 0.5)]


def test_a_step_on_which_bodies_pass_is_tried_again_with_care_before_it_is_cut():
    problems = [TooDeep, None]
    steps, cuts, taken = climb(lambda stiffness, length: problems.pop(0), watched=True)
    assert (steps, cuts, taken) == (1, 0, [(1.0, 1.0), (1.0, 1.0)])


@pytest.mark.parametrize("problem", [Diverged, TooDeep])
def test_what_never_works_ends_in_one_line(problem):
    with pytest.raises(SolveError, match=r"load factor .*: said"):
        climb(lambda stiffness, length: problem)


@pytest.mark.parametrize(("breaks", "left"), [(np.inf, 1.0), (0.05, 0.03)])
def test_in_the_end_they_rise_to_what_they_were_or_as_far_as_there_is_an_equilibrium(breaks, left):
    """By no more than four times at once, here in six equal ones, from an equilibrium to the next."""
    contact, tried = Springs(), []
    contact.stiffness = 0.0009

    def advance(factor, target):
        tried.append(contact.stiffness)
        if contact.stiffness > breaks:
            raise Diverged("said")

    ContactPolicy(SimpleNamespace(advance=advance, stabilisation=None), contact)._harden(1.0)
    assert tried == pytest.approx([0.0009 ** (k / 6) for k in range(5, -1, -1)][: len(tried)])
    assert len(tried) == (6 if breaks == np.inf else 4)
    assert contact.stiffness == pytest.approx(left)


def test_with_friction_a_step_is_cut_where_it_fails_and_penalties_stay():
    steps, cuts, taken = climb(lambda stiffness, length: Diverged if length > 0.5 else None, Rubbing())
    assert (steps, cuts) == (2, 1)
    assert taken == [(1.0, 1.0), (1.0, 0.5), (1.0, 0.5)]


def test_with_friction_a_step_is_cut_where_its_multipliers_fail():
    """It begins again where it began, with what contact was there."""
    contact, settled = Rubbing(), []

    def settle(factor):
        settled.append(factor)
        if len(settled) == 1:
            raise Diverged("said")
        return 3

    steps, cuts, taken = climb(lambda stiffness, length: None, contact, settle)
    assert (steps, cuts, contact.undone) == (2, 1, 1)
    assert settled == [1.0, 0.5, 1.0]
    assert taken == [(1.0, 1.0), (1.0, 0.5), (1.0, 0.5)]


def test_with_friction_no_step_is_longer_than_asked_for():
    contact = Rubbing()
    path = []
    solver = SimpleNamespace(
        steps=SimpleNamespace(turning=SimpleNamespace(longest_step=lambda factor: 1.0), watched=False, careful=False),
        assembler=SimpleNamespace(
            contact=contact, model=MODEL, touching=lambda x, factor: x, displacement=lambda x, factor: x
        ),
        x=Place(),
        advance=lambda factor, target: 1,
        forget_path=lambda: None,
        settle=lambda: None,
        stabilisation=None,
        guess=None,
        cuts=0,
    )
    solver.policy = ContactPolicy(solver, contact)
    solver.policy.settle = lambda factor: 0
    climbing.climb(
        solver,
        8,
        SimpleNamespace(reached=lambda x, factor: path.append(factor), left=lambda x, factor: None, outputs=[]),
    )
    assert path == pytest.approx(0.125 * np.arange(1, 9))


def test_a_first_guess_that_fails_is_dropped_and_no_step_cut():
    targets, reached = [], []

    def advance(factor, target):
        targets.append(target)
        if solver.guess is not None:
            solver.guess = None
            raise Diverged("from there is no way")
        return 1

    solver = SimpleNamespace(
        steps=SimpleNamespace(turning=SimpleNamespace(longest_step=lambda factor: 1.0), watched=False, careful=False),
        assembler=SimpleNamespace(contact=None, model=MODEL),
        x=None,
        advance=advance,
        forget_path=lambda: None,
        settle=lambda: None,
        stabilisation=None,
        guess="somewhere",
        policy=None,
        cuts=0,
    )
    climbing.climb(
        solver,
        1,
        SimpleNamespace(reached=lambda x, factor: reached.append(factor), left=lambda x, factor: None, outputs=[]),
    )
    assert (targets, reached, solver.cuts) == ([1.0, 1.0], [1.0], 0)


@pytest.mark.parametrize("fails", range(6))
def test_multipliers_change_by_half_as_much_each_time_that_fails(fails):
    """Three times; then they are what they were."""
    packed = SimpleNamespace(multipliers=np.array([1.0, 2.0]))
    tried = []

    def augment(displacement, in_cells):
        packed.multipliers = packed.multipliers + 8.0

    def advance(factor, target):
        tried.append(packed.multipliers.copy())
        if len(tried) <= fails:
            raise Diverged("no equilibrium")

    assembler = SimpleNamespace(**dict.fromkeys(("touching", "displacement"), lambda x, factor: np.zeros(2)))
    solver = SimpleNamespace(assembler=assembler, x=None, advance=advance, stabilisation=None)
    contact = Springs()
    contact.packed, contact.augment, contact.model = packed, augment, MODEL
    policy = ContactPolicy(solver, contact)
    problem = policy._update(1.0, False, np.ones(1))
    count = min(fails + 1, 4)
    assert [one[0] for one in tried] == [1.0 + 8.0 / 2**k for k in range(count)]
    assert (problem is None) == (fails < 4)
    assert packed.multipliers.tolist() == ([1.0 + 8.0 / 2**fails, 2.0 + 8.0 / 2**fails] if fails < 4 else [1.0, 2.0])
