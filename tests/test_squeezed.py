"""Load steps that crush a body are taken again in shorter ones, whether the prediction crushes it or the solution."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import straight

from isorod import Body, Model, NeoHookean, Space, Support, statics
from isorod.assembly.assembler import Assembler
from isorod.statics.convergence import squeezed


def wrung(displacement, turn):
    """A short bar of coarse elements whose end face is moved and turned far."""
    space = Space.paper(straight(4, height=4.0), elements=3, degree=2)
    end = Support.end(space, "end", displacement=displacement, turn=turn)
    return Model([Body(space, NeoHookean(1.0, 0.0))], [Support.end(space, "start"), end])


@pytest.mark.parametrize("load_steps", [1, 2, 4])
def test_no_step_leaves_less_than_a_fifth_of_the_volume_anywhere(load_steps, monkeypatch):
    """From one equilibrium to the next; the end is nearly closed up, at three hundredths of its volume."""
    model = wrung((0.13, 1.27, -0.87), (0.55, -2.81, 1.02))
    load_forces, found = Assembler.load_forces, []

    def kept(self, x, factor, step, out):
        # A load step begins with those of the equilibrium before.
        found.append(self.jacobians(x, factor)[0].copy())
        load_forces(self, x, factor, step, out)

    monkeypatch.setattr(Assembler, "load_forces", kept)
    solution = statics.solve(model, load_steps)
    assembler = Assembler(model)
    found.append(assembler.jacobians(assembler.state(solution.displacement), 1.0)[0])
    assert found[0] == pytest.approx(np.ones_like(found[0]), abs=1e-12)
    # Steps that were cut begin where the one before did, the first with anew what drives it.
    assert solution.load_steps < len(found) <= solution.load_steps + solution.cuts + 1
    shares = np.array([(after / before).min() for before, after in pairwise(found)])
    print("shares of the volume", np.sort(shares)[:5], "cuts", solution.cuts)
    assert found[-1].min() < 0.03
    assert shares.min() > 0.2


def test_volumes_are_compared_point_by_point():
    """A uniform stretch: refused from a fifth of the volume on, and the words name what happens and where."""
    model = wrung((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    space, assembler = model.bodies[0].space, Assembler(Model(model.bodies))
    states = {}
    for height in (1.0, 0.21, 0.19, -0.5):
        move = space.positions @ np.diag([0.0, 0.0, height - 1.0])
        states[height] = assembler.state(move.ravel())
    before = assembler.jacobians(states[1.0], 1.0)
    assert squeezed(assembler, before, states[1.0], 1.0) is None
    assert squeezed(assembler, before, states[0.21], 1.0) is None
    for height, what in ((0.19, "det F falls below 20 % of its previous value"), (-0.5, "an element inverts")):
        said = squeezed(assembler, before, states[height], 1.0)
        assert f"det F = {height}" in said and said.startswith(what)
    # Relative to what there was.
    assert squeezed(assembler, assembler.jacobians(states[0.21], 1.0), states[0.19], 1.0) is None
