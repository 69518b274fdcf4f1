"""Laws with memory on the finite element side: exact torsion, both sides alike, and what is refused."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from test_memory_statics import NU, SHEAR, YIELD, E, G, _bar

from comparisons.fem import known
from comparisons.fem.rods.run import mesh_of
from comparisons.fem.rods.solving import solve
from isorod import Body, Contact, Model, Plane, Space, Support, circle, statics, straight
from isorod.errors import InputError
from isorod.geometry.coils import helix
from isorod.material.plastic import Plastic
from isorod.material.viscous import Creep, Viscoelastic


def _both(law, x, history):
    made, body = _bar(law)
    turn = (0.0, 0.0, 4.0 * x * SHEAR / G)
    ends = [Support.end(made, "start"), Support.end(made, "end", turn=turn, history=history)]
    model = Model([body], ends)
    given = {"load_steps": 1, "end_time": history[-1][0]}
    return solve(model, mesh_of(model, 2), "statics", **given), statics.solve(model, **given)


def test_torsion_beyond_yield_and_back() -> None:
    law = Plastic(E, NU, [[0.0, YIELD]])
    found, ours = _both(law, 2.0, [[0, 0], [1, 1], [2, 0.5]])
    # Back by x elastically: 2.0289 less pi / 2.
    exact = (2.0289452554 - 0.5 * np.pi) * SHEAR
    assert found.moments[1, 2] == pytest.approx(exact, rel=0.01)
    assert ours.moments[1, 2] == pytest.approx(found.moments[1, 2], rel=0.01)
    stress, own = (one.stress(0, 0.5, [(0.0, 0.3), (0.0, 0.9)]) for one in (found, ours))
    assert stress == pytest.approx(own, abs=5e-3 * YIELD)
    norms = np.array(found.residual_norms)
    assert len(norms) < 8 and norms[-1] < 1e-6 * norms[0]


@pytest.mark.parametrize("law", [Viscoelastic(E, NU, [[0.5, 1.0]]), Creep(E, NU, 1e-9, 3.0)])
def test_held_twist_relaxes_alike(law) -> None:
    found, ours = _both(law, 0.5, [[0, 1], [2, 1]])
    first, _ = _both(law, 0.5, [[0, 1], [1e-6, 1]])
    assert found.moments[1, 2] < 0.8 * first.moments[1, 2]
    assert ours.moments[1, 2] == pytest.approx(found.moments[1, 2], rel=3e-3)


@pytest.mark.slow
def test_spring_of_index_five_pushed_past_yield_and_let_go() -> None:
    rod = helix(5.0, 5.5, 2).sweep(circle(8, 1.0))
    space = Space(rod)
    law = Plastic(210e3, 0.3, [[0.0, 1212.4], [0.1, 1422.4]])
    moved = Support.end(space, "end", displacement=(0.0, 0.0, -4.0), history=[[0, 0], [1, 1], [2, 0.25]])
    model = Model([Body(space, law)], [Support.end(space, "start"), moved])
    given = {"load_steps": 4, "end_time": 2.0}
    found, ours = solve(model, mesh_of(model, 2), "statics", **given), statics.solve(model, **given)
    # Of 260 where it is pushed farthest.
    assert ours.reactions[1, 2] == pytest.approx(found.reactions[1, 2], abs=0.005 * 260.0)


def test_what_is_not_there_is_said() -> None:
    made, body = _bar(Plastic(E, NU, [[0.0, YIELD]]))
    plane = Contact(0, Plane((0.0, 0.0, 4.001), (0.0, 0.0, -1.0)))
    with pytest.raises(InputError, match="beside which finite elements have no contact"):
        known.refuse(Model([body], [Support.end(made, "start")], contacts=[plane]), "statics")
    thick = Space(straight(4.0).sweep(circle(8, 1.0)))
    soft = Body(thick, Plastic(E, 0.495, [[0.0, YIELD]]))
    with pytest.raises(InputError, match="have no nearly incompressible bodies"):
        known.refuse(Model([soft], [Support.end(thick, "start")]), "statics")
