"""Scenes whose rods touch, against closed forms and other theories; sources stand beside the numbers."""

import numpy as np
import pytest

from isorod import statics
from isorod.errors import InputError
from isorod.scenes.coil import Coil
from isorod.scenes.strand import Strand

# Love's spring of an inextensible wire (A Treatise on the Mathematical Theory of Elasticity, art. 270 and 271): R = 10,
# d = 2, 5 coils, lead 10 degrees, E = 210e3, nu = 0.3; forces at 20 and 40 mm, and the way until the coils touch.
LOVE = {20.0: 78.754, 40.0: 155.37}
TOUCH = 45.39


def solved(scene, **how):
    solution = statics.solve(scene.model(), **how)
    return solution, scene.measure(solution)


@pytest.mark.parametrize("push", LOVE)
def test_coil_takes_the_force_of_loves_spring(push):
    _, found = solved(Coil(push=push))
    print(push, found["force"] / LOVE[push] - 1.0)
    # A continuum differs by the order of (d/D)^2 = 0.01: measured 0.0017.
    assert found["force"] == pytest.approx(LOVE[push], rel=0.003)
    assert found["contact_force"] == 0.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ends": "free"}, "ends: got 'free', need laid or clamped"),
        ({"push": 400.0}, "push: got 400, the wire is not as long"),
        ({"lead": 90.0}, "lead: got 90 degrees, need an angle between 0 and 90"),
        ({"wire_radius": 0.0}, "wire radius: got 0, need a positive length"),
        ({"elements_per_turn": 12}, "elements a turn: got 12, need a multiple of 8"),
    ],
)
def test_coil_refuses(options, message):
    with pytest.raises(InputError, match=message):
        Coil(**options).model()
