"""Stresses linear across the section pass a weld of two faces of one shape, whatever shape, functions and rules."""

import numpy as np
import pytest

from isorod import LinearElastic, Space, Tie, airfoil, circle, ellipse, flower, rounded_rectangle, statics, straight
from isorod.assembly.constraints import Constraints
from isorod.model import Body, Model, Support
from isorod.model.history import InTime
from isorod.model.tie import EndFace
from isorod.space.trace import end_trace

# Strains are to be small.
SIZE, LENGTHS = 1e-4, (4.0, 3.0)

IRREGULAR = circle(8) * np.array([1.3, 0.8, 1.2, 1.0, 0.7, 1.25, 0.9, 1.1])[:, None]
SHAPES = {
    "irregular": IRREGULAR,
    "ellipse": ellipse(8, 2.0, 0.5),
    "flower": flower(),
    "airfoil": 10.0 * airfoil(),
    "rounded rectangle": rounded_rectangle(24, 2.0, 1.0, 0.2),
}
SPACES = {
    "control points": {"order": 2, "elements": 2, "degree": 3},
    "higher order": {"order": 3, "elements": 3, "degree": 4},
    "polynomials": {"section_degree": 3, "elements": 2, "degree": 3},
    "chosen": {},
}
CASES = [
    *(("irregular", *pair) for pair in (("control points", "higher order"), ("chosen", "polynomials"))),
    ("ellipse", "polynomials", "control points"),
    ("flower", "polynomials", "control points"),
    ("airfoil", "control points", "polynomials"),
    ("rounded rectangle", "polynomials", "control points"),
]


def lines():
    """Return the centre lines of two bars end on end."""
    return straight(LENGTHS[0]), straight(LENGTHS[1], start=(0.0, 0.0, LENGTHS[0]))


def rule_of(space, which):
    """Return the points of a face by the rule of the elements: `Trace`, linear fields there, and radii on the disk."""
    trace = end_trace(space, which, own=True)
    radius = np.linalg.norm(space.section_rule(space.rule)[0], axis=1)
    return trace, np.column_stack([np.ones(len(radius)), trace.points[:, :2]]), radius


class OnFace(InTime):
    """A traction along the axis on the end of a body, by the rule of its elements."""

    def __init__(self, body, traction):
        super().__init__()
        self._set(body=body, traction=traction)

    def nodal(self, space):
        trace, fields, radius = rule_of(space, "end")
        result = np.zeros((space.nodes, 3))
        result[trace.nodes[0], 2] = trace.values.T @ (trace.weights * self.traction(fields, radius))
        return result


def bent(x, strain, start, turn, z):
    """Return the displacement of a bar whose strain along it is ``strain @ (1, x, y)``, without contraction."""
    across = start[:2] + np.outer(z, turn) - 0.5 * np.outer(z**2, strain[1:])
    return np.column_stack([across, start[2] - x[:, :2] @ turn + (strain[0] + x[:, :2] @ strain[1:]) * z])


def passes(spaces, moduli, turned, law, joint=2.0):
    """Pull and bend two welded bars and hold displacement and traction to those of bars of their rules' sections.

    ``moduli`` are those of each bar within and beyond the radius ``joint`` of the disk.
    """
    strain = [np.zeros(3), np.array([0.3, 1.0, -0.7])]
    stiff = []
    for space, (inner, outer), which in zip(spaces, moduli, ("end", "start"), strict=True):
        trace, fields, radius = rule_of(space, which)
        stiff.append(fields.T @ ((trace.weights * np.where(radius < joint, inner, outer))[:, None] * fields))
    strain[0] = np.linalg.solve(stiff[0], stiff[1] @ strain[1])

    def traction(body):
        inner, outer = moduli[body]
        return lambda fields, radius: SIZE * np.where(radius < joint, inner, outer) * (fields @ strain[body])

    faces = EndFace(1, "start"), EndFace(0, "end")
    model = Model(
        [Body(space, law(*pair)) for space, pair in zip(spaces, moduli, strict=True)],
        [Support.end(spaces[0], "start")],
        loads=[OnFace(1, traction(1))],
        ties=[Tie(*(faces[::-1] if turned else faces))],
    )
    found = statics.solve(model)
    length = LENGTHS[0]
    starts = np.zeros(3), np.append(-0.5 * strain[0][1:] * length**2, strain[0][0] * length)
    turns = np.zeros(2), -strain[0][1:] * length
    for body, space in enumerate(spaces):
        along, xi = np.linspace(0.0, 1.0, 7), space.section_rule(space.rule)[0]
        places = space.rod.grid(xi, along)[0]
        x = places.reshape(-1, 3)
        moved = bent(x, strain[body], starts[body], turns[body], x[:, 2] - length * body).reshape(places.shape)
        # As thin as an airfoil is, round-off of its bending is more.
        assert np.abs(found.at(body, along, xi) / SIZE - moved).max() < 1e-9 * np.abs(moved).max()
    tie, sign = found.ties[0], (1.0 if turned else -1.0)
    assert tie.jump < 1e-9 * SIZE * np.abs(moved).max()
    # The resultants are those of the load, which is that of the rule of the upper bar's elements.
    force = stiff[1] @ strain[1]
    assert -sign * tie.force[2] / SIZE == pytest.approx(-force[0], rel=1e-9)
    arm = tie.center
    moment = [force[2] - arm[1] * force[0], -(force[1] - arm[0] * force[0]), 0.0]
    assert sign * tie.moment / SIZE == pytest.approx(moment, abs=1e-9 * np.abs(force).max())
    if joint > 1.0:
        fields = np.column_stack([np.ones(len(tie.points)), tie.points[:, :2]])
        side = 0 if turned else 1
        wanted = sign * moduli[side][0] * fields @ strain[side]
        assert tie.traction[:, 2] / SIZE == pytest.approx(wanted, abs=1e-8 * np.abs(wanted).max())


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("shape", *"ab"), CASES)
def test_linear_stresses_pass_faces_of_any_shape(shape, a, b, turned):
    # Control points that are counted from another one are mapped by another disk.
    sections = SHAPES[shape], np.roll(SHAPES[shape], 3, axis=0)
    rods = [line.sweep(section) for line, section in zip(lines(), sections, strict=True)]
    spaces = [Space(rod, **SPACES[name]) for rod, name in zip(rods, (a, b), strict=True)]
    passes(spaces, [(10.0, 10.0), (3.0, 3.0)], turned, lambda E, _: LinearElastic(E, 0.0))


@pytest.mark.parametrize("turned", [False, True])
def test_linear_stresses_pass_faces_of_hollow_rods(turned):
    line, radii = lines(), ((0.5, 1.0), (0.5, 0.7, 1.0))
    rods = [one.sweep(IRREGULAR).with_rings(rings) for one, rings in zip(line, radii, strict=True)]
    spaces = [Space(rods[0], section_degree=3, elements=2, degree=3), Space(rods[1], section_degree=4, elements=2)]
    passes(spaces, [(10.0, 10.0), (3.0, 3.0)], turned, lambda E, _: LinearElastic(E, 0.0))


@pytest.mark.parametrize("turned", [False, True])
def test_stresses_that_jump_between_layers_pass_faces_of_layered_rods(turned):
    rods = [one.sweep(circle(8)).with_rings((0.0, 0.6, 1.0)) for one in lines()]
    spaces = [
        Space(rods[0], section_degree=3, elements=2, degree=3, quadrature="full"),
        Space(rods[1], section_degree=5, elements=3, degree=4, quadrature="full"),
    ]
    law = lambda inner, outer: (LinearElastic(inner, 0.0), LinearElastic(outer, 0.0))  # noqa: E731
    passes(spaces, [(20.0, 2.0), (30.0, 3.0)], turned, law, joint=0.6)


def test_an_end_passes_linear_stresses_to_a_part_of_a_larger_face():
    rods = [line.sweep(section) for line, section in zip(lines(), (2.0 * circle(8), IRREGULAR), strict=True)]
    spaces = [Space(rods[0], **SPACES["higher order"]), Space(rods[1], **SPACES["control points"])]
    bodies = [Body(space, LinearElastic(1.0, 0.3)) for space in spaces]
    tied = Constraints(Model(bodies, ties=[Tie(EndFace(1, "start"), EndFace(0, "end"))])).ties[0]
    trace, fields, _ = rule_of(spaces[1], "start")
    forces = np.zeros((len(tied.slaves), 3))
    nodes = trace.nodes[0] + spaces[0].nodes
    moments = trace.values.T @ (trace.weights[:, None] * fields)
    along = tied.slaves % 3 == 2
    forces[along] = moments[[list(nodes).index(node) for node in tied.slaves[along] // 3]]
    found = (tied.rows.T @ forces)[2::3]
    # Of the master's functions the integrals over the same face, but for what both rules have not in common.
    other = tied.jump + tied.own
    wide = np.column_stack([np.ones(len(tied.trace.points)), tied.trace.points[:, :2]])
    wanted = other.T @ (tied.trace.weights[:, None] * wide)
    assert found == pytest.approx(wanted, abs=1e-3 * np.abs(wanted).max())
    difference = found - wanted
    arms = np.zeros((len(found), 3))
    arms[: spaces[0].nodes] = np.column_stack([spaces[0].is_control_point, spaces[0].positions[:, :2]])
    linear = wanted @ np.linalg.solve(arms.T @ wanted, arms.T @ difference)
    assert difference == pytest.approx(linear, abs=1e-12)
