"""Random pairs of rods, one pushed against the other by its ends, as far as through it, and the rule for them."""

import warnings
from time import perf_counter

import numpy as np

from isorod import Body, Contact, Model, NeoHookean, Rod, SolveError, Space, Support, circle, ellipse, statics, straight
from isorod.checks import overlap

LAW = NeoHookean(1000.0, 0.3)
ACROSS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # z to x
ROD = straight(6.0, (0.0, 1.0, 2.0, 3.0), 2).sweep(circle(8, 1.0))
POINTS = ROD.control_points - [0.0, 0.0, 3.0]


def rods(*shifts, turn=None, contacts=(), supports=()):
    """Rods of radius 1, the first along z, the others shifted, and turned if told."""
    places = [POINTS, *((POINTS if turn is None else POINTS @ turn.T) + np.array(shift) for shift in shifts)]
    spaces = [Space.paper(Rod(ROD.axis, points), order=2, quadrature="auto") for points in places]
    return Model([Body(space, LAW, 1.0) for space in spaces], supports, contacts=contacts)


def pair(seed):
    """Return a model of two rods, along x and aslant to it in the x-z plane, the second pushed down on the first."""
    rng = np.random.default_rng(seed)
    sizes = rng.uniform(0.5, 1.5, 2)
    angle = rng.choice([0.0, rng.uniform(0.0, 0.5 * np.pi)], p=[0.1, 0.9])
    gap, way = rng.uniform(0.02, 1.0), rng.choice([0.3, 1.0, 2.0, 4.0]) * rng.uniform(0.5, 1.5)
    spaces = []
    for k, radius in enumerate(sizes):
        length = 2.0 * sizes.max() * rng.uniform(4.0, 12.0)
        rod = straight(length, tuple(np.linspace(0.0, 1.0, rng.integers(4, 7))), 2)
        outline = circle(8, radius) if rng.random() < 0.7 else ellipse(8, radius, radius * rng.uniform(0.5, 1.0))
        points = rod.sweep(outline).control_points - [0.0, 0.0, length * rng.uniform(0.4, 0.6)]
        turn = angle * k
        turned = np.array([[np.cos(turn), 0.0, np.sin(turn)], [0.0, 1.0, 0.0], [-np.sin(turn), 0.0, np.cos(turn)]])
        lift = k * (sizes.sum() + gap)
        moved = points @ turned.T + [k * rng.uniform(-0.2, 0.2) * sizes.min(), lift, 0.0]
        spaces.append(Space.paper(Rod(rod.axis, moved), degree=2, order=2, quadrature="auto"))
    push = (0.0, -gap - way * sizes.sum(), 0.0)
    supports = [Support.end(spaces[0], end) for end in ("start", "end")]
    supports += [Support.end(spaces[1], end, displacement=push, body=1) for end in ("start", "end")]
    penalty = rng.choice([None, 10.0 ** rng.uniform(0.0, 4.0)])
    model = Model([Body(one, LAW) for one in spaces], supports, contacts=[Contact(0, 1, penalty)])
    return model, int(rng.integers(1, 5)), float(sizes.min())


def side(model, displacement):
    """Return on which side of the first centre line the second is, where they are nearest: the sign of a volume."""
    lines = []
    for b, body in enumerate(model.bodies):
        u = np.linspace(*body.space.axis.breaks[[0, -1]], 201)
        moved, _ = body.space.displacement(model.nodal(displacement, b), [[0.0, 0.0]], u)
        lines.append(body.space.rod.grid([[0.0, 0.0]], u)[0][:, 0] + moved[:, 0])
    gaps = np.linalg.norm(lines[0][:, None] - lines[1], axis=2)
    i, j = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
    tangents = [np.gradient(line, axis=0)[k] for line, k in zip(lines, (i, j), strict=True)]
    tangents = [one / np.linalg.norm(one) for one in tangents]
    return float(np.cross(*tangents) @ (lines[1][j] - lines[0][i])), float(gaps.min())


def outcome(seed):
    """Push a pair and return what came of it in a word or two, and the seconds; raises where the rule is broken.

    The rule: what is found balances, to rounding where this is warned of, no point is deeper than half a radius, no rod
    has come out at the far side, and what is deeper than contact is to let it is warned of; or there is one line that
    says why not.
    """
    model, steps, radius = pair(seed)
    start = perf_counter()
    try:
        with warnings.catch_warnings(record=True, action="always") as said:
            found = statics.solve(model, load_steps=steps)
    except SolveError as problem:
        assert "\n" not in str(problem), seed
        return f"refused: {problem}", perf_counter() - start
    seconds = perf_counter() - start
    (contact,) = found.contacts
    forces = found.reactions
    rounding = any(str(one.message).startswith("support reactions are at round-off level") for one in said)
    # Rods that never touch are moved as they are.
    assert np.abs(forces.sum(axis=0)).max() <= (1e-9 if rounding else 1e-6 * np.abs(forces).max()), seed
    assert contact.relative_penetration <= 0.5, seed
    before, after = side(model, np.zeros(model.dofs)), side(model, found.displacement)
    if min(abs(before[0]), abs(after[0])) > 0.3 * radius:
        assert before[0] * after[0] > 0.0, (seed, before, after)
    deep = overlap.deepest(model, found.displacement)
    warned = any(str(one.message).startswith("final overlap: ") for one in said)
    assert warned or deep is None or deep.relative < 0.12, (seed, deep)
    return f"{'warned of' if warned else 'right'}: penetration {contact.relative_penetration:.2g}", seconds
