"""How far estimates of error are from errors: what is compared, and the fractions that are near.

Stresses are compared at 20 places of the surface farther from ends and jumps of laws than the section is wide.  Without
an estimate an error above half a percent is infinitely far from it.
"""

from collections.abc import Mapping, Sequence
from math import inf
from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.command import solving
from isorod.output import held

# Smaller errors are the reference's own, larger ones need an estimate; of stress.
SMALLEST, LARGE, LARGE_STRESS = 1e-6, 5e-3, 0.03

# Estimates of stresses that are warned of.
WARNED_STRESS = solving.LARGE_STRESS

# Places at which stresses are compared.
PLACES = 20

# Largest difference of two references, relative to the error.
APART = (0.1, 0.5)


def carried(solution: Any) -> list[tuple[Array, float]]:
    """Return forces and moments of supports, and the sizes to which their errors are relative; none of modes."""
    if not hasattr(solution, "reactions"):
        return []
    space, width = solution.model.bodies[0].space, float(held.width(solution.model, 0))
    force, moment = (float(np.linalg.norm(one, axis=1).max()) for one in (solution.reactions, solution.moments))
    # Of forces that are next to nothing beside the loads, or beside what moves or turns the rod, and of moments beside
    # forces, no one asks.
    loads = [np.abs(load.nodal(space)).sum() for load in solution.model.loads if hasattr(load, "nodal")]
    moving = solution.energy(0) / np.abs(solution.displacement).max()
    force = max(force, 1e-3 * max(float(sum(loads)), moment / width, moving))
    return [(solution.reactions, force), (solution.moments, max(moment, force * width))]


def off(one: Sequence[tuple[Array, float]], other: Sequence[tuple[Array, float]]) -> float:
    """Return by how much answers differ, at the most."""
    pairs = zip(one, other, strict=True)
    return max((float(np.linalg.norm(a - b, axis=1).max() / size) for (a, _), (b, size) in pairs if size), default=0.0)


def stresses_at(seed: int, solution: Any) -> Array | None:
    """Return Cauchy's stress at random places of the surface, ``(places, 3, 3)``; None of modes."""
    if not hasattr(solution, "errors"):
        return None
    rng, model = np.random.default_rng([seed, PLACES]), solution.model
    body, axis = model.bodies[0], model.bodies[0].space.rod.axis
    u = rng.uniform(axis.breaks[0], axis.breaks[-1], 50 * PLACES)
    jumps = axis.breaks if len(set(map(id, body.laws))) > 1 else axis.breaks[[0, -1]]
    u = u[held.distance(model, 0, u, jumps) > held.width(model, 0)][:PLACES]
    angle = rng.uniform(0.0, 2.0 * np.pi, u.size)
    values = [solution.stress(0, u[k], (np.cos(angle[k]), np.sin(angle[k]))) for k in range(u.size)]
    return np.array(values).reshape(-1, 3, 3)


def ratio(record: Mapping[str, Any], apart: float, of: str = "") -> float | None:
    """Return error over estimate; None where the references are further apart than a fraction of the error.

    ``of`` is ``"stress "`` for that of stresses.
    """
    if f"{of}error" not in record:
        return None
    error, estimate = record[f"{of}error"], record[f"{of}estimate"]
    if not error > SMALLEST or record[f"{of}apart"] > apart * error:
        return None
    if not estimate:
        return inf if error > (LARGE_STRESS if of else LARGE) else None
    return float(error / estimate)


def statistics(ratios: Sequence[float | None]) -> dict[str, Any]:
    """Return how many ratios count, the fraction within a factor of 3, and how far errors are above and below."""
    counted = [one for one in ratios if one is not None]
    if not counted:
        return {"rods": len(ratios), "counted": 0}
    within = float(np.mean([1.0 / 3.0 <= one <= 3.0 for one in counted]))
    largest = max(counted)
    return {
        "rods": len(ratios),
        "counted": len(counted),
        "within 3": within,
        "least": min(counted),
        "largest": largest if np.isfinite(largest) else "without an estimate",
    }
