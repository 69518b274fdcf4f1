"""The coat hanger as a frame of beams: of one solid of tetrahedra its wire, thin and long, is known to 2.6 % only."""

import itertools
from pathlib import Path

import numpy as np

from comparisons.stability.frame import Array, Bar, Frame
from isorod import files
from isorod.geometry.rod import Rod

# Beams of the frame and of the hook.
BEAMS = 400, 60
# What the file has: radius of the wire, mm, E, MPa, nu; radius of a lower bend, and the length at which stress is.
WIRE, E, NU = 1.5, 2.06e5, 0.3
BEND, PLACE = 12.0, 174.5


def found(file: Path, part: int) -> dict[str, float]:
    """Return sag and stress by ``part`` times `BEAMS` straight beams, joined at axes.

    The stress is inside the lower bend, of the beams' moment and tension by Winkler's theory of curved beams.
    """
    model = files.find(str(file)).model()
    wire, hook = (body.space.rod for body in model.bodies)
    (coat,) = model.loads
    area, inertia, shear = np.pi * WIRE**2, 0.25 * np.pi * WIRE**4, 0.5 * E / (1.0 + NU)
    # Cowper's share of the area of a round section in shear.
    share = 6.0 * (1.0 + NU) / (7.0 + 6.0 * NU)
    bar, normal = Bar(E * area, share * shear * area, (E * inertia, E * inertia), 2.0 * shear * inertia), np.eye(3)[1]
    frame, where = Frame(), _along(wire, part * BEAMS[0])
    nodes = frame.line(_axis(wire, where), bar, normal)
    # The frame is closed.
    frame.rows += [({6 * nodes[0] + k: 1.0, 6 * nodes[-1] + k: -1.0}, 0.0) for k in range(6)]
    for one, other in itertools.pairwise(nodes):
        weight = area * np.linalg.norm(frame.places[other] - frame.places[one]) * np.array(coat.density)
        frame.pull(one, 0.5 * weight)
        frame.pull(other, 0.5 * weight)
    last = frame.line(_axis(hook, _along(hook, part * BEAMS[1])), bar, normal, nodes[0])[-1]
    for way in np.eye(3):
        frame.hold(last, way)
        frame.hold(last, way, turn=True)
    frame.solve()
    k = int(np.argmin(np.abs(0.5 * (where[1:] + where[:-1]) - PLACE)))
    return {"sag": float(frame.moved[nodes[0], 2]), "stress": abs(_inside(frame, k, area))}


def _along(rod: Rod, count: int) -> Array:
    low, high = rod.axis.breaks[[0, -1]]
    return np.linspace(float(low), float(high), count + 1)


def _axis(rod: Rod, u: Array) -> Array:
    return rod.grid([[0.0, 0.0]], u)[0].reshape(-1, 3)


def _inside(frame: Frame, k: int, area: float) -> float:
    """Return the stress along a bend, at its inside, from the forces of bar number ``k``."""
    ends, axes = frame.ends[k], frame.bars[k][3]
    moment = 0.5 * axes[:2].T @ (ends[9:11] - ends[3:5])
    before, here, after, beyond = frame.places[k - 1 : k + 3]
    bent = np.cross(here - before, beyond - after)
    # The neutral fibre of a round section, and how far it is from the axis.
    neutral = 0.5 * WIRE**2 / (BEND - np.sqrt(BEND**2 - WIRE**2))
    off = BEND - neutral
    bending = (neutral - BEND + WIRE) / (area * off * (BEND - WIRE))
    return float(ends[8] / area - moment @ bent / np.linalg.norm(bent) * bending)
