"""A load step with friction that fails is taken with softer penalties, which rise again before it ends."""

from types import SimpleNamespace

import numpy as np
import pytest

from isorod.statics.contact_policy import ContactPolicy
from isorod.statics.steps import Diverged
from isorod.statics.tuning import CONTROL


class Contact:
    """Penalties that may fall to a thousandth."""

    stiffness, friction, has_defaults, model = 1.0, "some", True, SimpleNamespace(times=None)
    points, ahead = (), None

    def stiffen(self, times):
        self.stiffness *= times

    def keep(self):
        before = self.stiffness
        return lambda: setattr(self, "stiffness", before)

    def settled(self):
        return SimpleNamespace(penalties=None)

    def place(self, factor):
        pass

    accept = place


@pytest.fixture
def contact():
    return Contact()


@pytest.fixture
def solver(contact):
    """Return a solver that finds an equilibrium with soft penalties alone, and starts at nothing."""

    def advance(factor, target):
        if not contact.stiffness < 0.5:
            raise Diverged("SNES diverged")
        return 3

    x = SimpleNamespace(copy=lambda other=None: x)
    assembler = SimpleNamespace(touching=lambda x, factor: factor, displacement=lambda x, factor: np.zeros(1))
    steps = SimpleNamespace(careful=True)
    return SimpleNamespace(assembler=assembler, x=x, steps=steps, advance=advance, forget_path=lambda: None)


def test_a_step_that_fails_is_taken_with_softer_penalties_and_the_next_begins_with_them(solver, contact):
    policy, begun = ContactPolicy(solver, contact), []

    def settle(factor):
        begun.append(contact.stiffness)
        contact.stiffness = 1.0
        return 2

    policy.settle = settle
    assert policy.step(0.0, 0.5) == policy.step(0.5, 1.0) == (3, 2)
    assert contact.stiffness == 1.0
    assert begun == [CONTROL.softer, CONTROL.softer]


def test_a_step_whose_penalties_stay_soft_is_none(solver, contact):
    policy = ContactPolicy(solver, contact)
    policy.settle = lambda factor: 2
    with pytest.raises(Diverged, match="no equilibrium at the required penalty"):
        policy.step(0.0, 0.5)
    assert contact.stiffness == 1.0


def test_a_step_that_nobody_is_careful_of_is_not_softened(solver, contact):
    solver.steps.careful = False
    with pytest.raises(Diverged, match="SNES diverged"):
        ContactPolicy(solver, contact).step(0.0, 0.5)
