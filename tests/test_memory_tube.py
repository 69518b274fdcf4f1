"""A tube that yields under pressure: plane strain, incompressible, against Hill."""

import numpy as np
import pytest

from isorod import Body, Model, Space, Support, circle, statics, straight
from isorod.material.plastic import Plastic
from isorod.model import Pressure

INNER, OUTER, YIELD, G = 1.0, 2.0, 1.0, 1e4


@pytest.mark.parametrize(("until", "pressure"), [(1.25, 0.6094867991), (1.5, 0.7207815214)])
def test_a_tube_yields_from_within(until: float, pressure: float) -> None:
    # p/s0 = 2/sqrt3 (ln(c/a) + (1 - c^2/b^2)/2), u = s0 c^2/(2 sqrt3 G r).
    exact = 2.0 / np.sqrt(3.0) * (np.log(until / INNER) + 0.5 * (1.0 - (until / OUTER) ** 2))
    assert pressure == pytest.approx(exact, rel=1e-9)
    rod = straight(1.0).sweep(circle(8, OUTER)).with_rings((INNER / OUTER, 1.0))
    space = Space(rod, section_degree=5, elements=1, degree=2, quadrature="12x4x3")
    held = [Support.end(space, which, "z") for which in ("start", "end")]
    held += [Support(np.array([0]), "xy"), Support(np.array([1]), "y")]
    law = Plastic(3.0 * G, 0.5, [[0.0, YIELD]])
    found = statics.solve(Model([Body(space, law)], held, loads=[Pressure(pressure, "inner")]))
    radii = np.array([INNER, 1.5, OUTER])
    moved, _ = space.displacement(found.displacement, np.outer(radii / OUTER, (np.cos(0.7), np.sin(0.7))), [0.5])
    outwards = moved[0, :, :2] @ (np.cos(0.7), np.sin(0.7))
    assert outwards == pytest.approx(YIELD * until**2 / (2.0 * np.sqrt(3.0) * G * radii), rel=5e-3)
