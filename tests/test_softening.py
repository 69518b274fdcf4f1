"""A load step with friction that fails is taken with softer penalties, which rise again before it ends."""

from types import SimpleNamespace

import pytest

from isorod.statics import climb
from isorod.statics.steps import Diverged


class Contact:
    """Penalties that may fall to a thousandth."""

    stiffness = 1.0

    def stiffen(self, times):
        self.stiffness *= times

    def keep(self):
        before = self.stiffness
        return lambda: setattr(self, "stiffness", before)

    def place(self, factor):
        pass

    accept = place

    @property
    def is_soft(self):
        return self.stiffness < 0.5

    @property
    def may_soften(self):
        return self.stiffness > 1e-3


@pytest.fixture
def solver():
    """Return a solver that finds an equilibrium with soft penalties alone, and starts at nothing."""
    contact = Contact()

    def advance(factor, target):
        if not contact.is_soft:
            raise Diverged("SNES diverged")
        return 3

    x = SimpleNamespace(copy=lambda other=None: x)
    assembler = SimpleNamespace(contact=contact, displacement=lambda x, factor: factor)
    steps = SimpleNamespace(careful=True)
    return SimpleNamespace(assembler=assembler, x=x, steps=steps, advance=advance, forget_path=lambda: None)


def test_a_step_that_fails_is_taken_with_softer_penalties(solver, monkeypatch):
    contact = solver.assembler.contact

    def settle(solver, factor):
        contact.stiffness = 1.0
        return 2

    monkeypatch.setattr(climb, "settle", settle)
    assert climb._rub(solver, 0.0, 0.5, 1.0) == (3, 2, climb.SOFTER)
    assert contact.stiffness == 1.0


def test_a_step_whose_penalties_stay_soft_is_none(solver, monkeypatch):
    monkeypatch.setattr(climb, "settle", lambda solver, factor: 2)
    with pytest.raises(Diverged, match="no equilibrium with penalties as high as they have to be"):
        climb._rub(solver, 0.0, 0.5, 1.0)
    assert solver.assembler.contact.stiffness == 1.0


def test_a_step_that_nobody_is_careful_of_is_not_softened(solver):
    solver.steps.careful = False
    with pytest.raises(Diverged, match="SNES diverged"):
        climb._rub(solver, 0.0, 0.5, 1.0)
