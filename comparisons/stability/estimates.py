"""How far estimates of error are from errors: random rods, laws, loads and spaces, too coarse ones too.

``python -m comparisons.stability.estimates 200`` prints a line a rod, and in the end the shares (``100 200`` those of
seeds from 100 on).  Errors are against the finer of two references; how far these are apart says how sure that is.
Shares are told of errors to which they are within a tenth, and within a half.  Without an estimate an error above half
a percent is infinitely far from it.  Of statics stresses are compared too, at 20 places of the surface farther from
ends and jumps of laws than the section is wide, relative to the largest of these; and it is told which of the spaces
that were chosen are off by more than half a percent, or 3 percent of stress, without a warning.
"""

import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Any, cast

import numpy as np

from isorod import modal, options, statics
from isorod.arrays import Array
from isorod.command import solving
from isorod.errors import InputError, SolveError
from isorod.geometry import center_line, coils, section
from isorod.geometry.rod import Rod
from isorod.material import LinearElastic, NeoHookean
from isorod.model import Body, Model, Pressure, SectionLoad, Support
from isorod.output import held, results
from isorod.space import Space, choice

# Errors below are those of the reference, and larger than that those that need an estimate; of stress.
SMALLEST, LARGE, LARGE_STRESS = 1e-6, 5e-3, 0.03

# Estimates of stresses that are warned of.
WARNED_STRESS = solving.LARGE_STRESS

# Places at which stresses are compared.
PLACES = 20

# What two references may differ by, as a share of the error.
APART = (0.1, 0.5)

KINDS = ("load", "moved end", "turned end", "pressure", "modes")


def rod(rng: np.random.Generator) -> tuple[Rod, float]:
    """Return a random rod, and the force that bends it about as far as it is long.

    Straight, an arc, a part of a helix, or a curve through points; tapered and twisted or not; round, elliptical, with
    round corners or an airfoil; solid, hollow or in layers.
    """
    outline = [
        section.circle(8),
        section.ellipse(8, 1.0, rng.uniform(0.1, 1.0)),
        section.rounded_rectangle(16, 2.0, rng.uniform(0.5, 2.0), 0.2),
        section.airfoil(),
    ][rng.choice(4, p=(0.4, 0.3, 0.15, 0.15))]
    way = np.linspace(0.0, 1.0, 8)[:, None] * rng.uniform(0.5, 1.5, size=3)
    line = [
        center_line.straight(10.0 ** rng.uniform(0.5, 2.0)),
        coils.arc(rng.uniform(4.0, 20.0), rng.uniform(20.0, 180.0)),
        coils.helix(rng.uniform(3.0, 10.0), rng.uniform(4.0, 8.0), rng.uniform(0.1, 0.6)),
        center_line.polyline(20.0 * np.stack([np.sin(way[:, 0]), way[:, 1] ** 2, way[:, 2]], axis=1), 0.05),
    ][rng.choice(4, p=(0.4, 0.25, 0.2, 0.15))]
    end, last = rng.uniform(0.4, 1.0), line.axis.breaks[-1]
    taper: dict[str, Any] = {"scale": lambda u: 1.0 + (end - 1.0) * u / last, "twist": rng.uniform(-60.0, 60.0)}
    made = line.sweep(outline, **(taper if rng.random() < 0.4 else {}))
    made.check()
    kind = rng.choice(3, p=(0.8, 0.1, 0.1))
    if kind:
        made = made.with_rings((rng.uniform(0.3, 0.9), 1.0) if kind == 1 else (0.0, rng.uniform(0.3, 0.9), 1.0))
    centers = made.control_points.mean(axis=1)
    length = np.linalg.norm(np.diff(centers, axis=0), axis=1).sum()
    wide, thin = np.linalg.svd(outline - outline.mean(axis=0), compute_uv=False) / np.sqrt(0.5 * len(outline))
    return made, float(wide * thin**3 / length**2)


def space(rng: np.random.Generator, made: Rod) -> Space:
    """Return the space that is chosen, or another, most often a coarser one."""
    kind = rng.choice(3, p=(0.4, 0.4, 0.2))
    if kind == 0:
        return Space(made)
    degree = int(rng.integers(max(2, made.axis.degree), 6))
    elements = int(rng.integers(1, 5)) * made.axis.elements
    continuity = int(rng.choice([0, degree - 1]))
    if kind == 1 or len(made.rings) > 2 or made.rings[0] > 0.0:
        across = int(rng.integers(1, 6))
        return Space(made, degree=degree, section_degree=across, elements=elements, continuity=continuity)
    return Space.paper(made, elements, degree, continuity, "full", int(rng.integers(1, 4)))


def laws(rng: np.random.Generator, made: Rod) -> Any:
    """Return one law, or those of layers, or of two parts along the rod."""
    nu = float(rng.choice([0.0, 0.3, 0.45, 0.49, 0.499]))
    kinds: Any = [NeoHookean, LinearElastic]
    law = rng.choice(kinds)(1.0, nu)
    soft = replace(law, E=10.0 ** rng.uniform(-2.0, 0.0), nu=min(nu, 0.45))
    if len(made.rings) > 2:
        return [soft, law]
    parts = made.axis.elements
    if parts > 1 and rng.random() < 0.4:
        return [law] * (parts // 2) + [soft] * (parts - parts // 2)
    return law


def solve(on: Space, kind: str, law: Any, vector: Array, size: float) -> tuple[Array, Any]:
    """Return what is measured of a solution, and the solution: work of loads, of a moved end, or frequencies.

    Forces and moments of supports are measured beside (`carried`).
    """
    body = Body(on, law, 1.0)
    start = Support.end(on, "start")
    if kind == "modes":
        found = modal.solve(Model([body], [start]), 4)
        return found.frequencies, found
    if kind in ("load", "pressure"):
        load: Any = SectionLoad.end(on, "end", (vector[0], vector[1], vector[2]))
        if kind == "pressure":
            load = Pressure(0.1 * size, "inner" if on.rod.rings[0] > 0.0 else "outer")
        loaded = statics.solve(Model([body], [start], loads=[load]))
        return np.array([load.nodal(on).ravel() @ loaded.displacement]), loaded
    how: dict[str, Any] = {"displacement": tuple(vector)} if kind == "moved end" else {"turn": tuple(vector)}
    moved = statics.solve(Model([body], [start, Support.end(on, "end", **how)]))
    return np.array([moved.work]), moved


def problem(seed: int) -> tuple[Space, Callable[[Space], tuple[Array, Any]], dict[str, Any]]:
    """Return a random space, what solves its problem on that or another, and what it is."""
    rng = np.random.default_rng(seed)
    made, stiff = rod(rng)
    on, law = space(rng, made), laws(rng, made)
    kind = str(rng.choice(KINDS, p=(0.3, 0.2, 0.1, 0.15, 0.25)))
    # From small to finite deformation, but no buckling in a random direction.
    size = 10.0 ** rng.uniform(-3.0, -0.8)
    vector = rng.normal(size=3)
    vector *= size * {"load": stiff, "moved end": 3.0}.get(kind, 1.0) / np.linalg.norm(vector)
    told = {"kind": kind, "rod": repr(made), "law": str(law), "space": str(on), "size": size}
    return on, lambda other: solve(other, kind, law, vector, size), told


def compare(seed: int) -> dict[str, Any]:
    """Return true error and estimate of one random rod, and how far two references are apart."""
    on, solved, told = problem(seed)
    found, solution = solved(on)
    estimate, stress = solution.errors() if hasattr(solution, "errors") else (solution.estimate(), None)
    made = on.rod
    least, across = max(cast(int, on.elements), cast(int, Space(made).elements)), max(on.section_degree or 4, 3)
    # Those of rods with rings have functions enough.
    whole = len(made.rings) == 2 and made.rings[0] == 0.0
    references, stresses, supports = [], [stresses_at(seed, solution)], [carried(solution)]
    for more, parts in ((1 + whole, 1), (2 + whole, 1 + (on.axis.degree > 4 or on.elements == least))):
        elements, even = parts * least, made.axis.refine(parts * least // made.axis.elements, 6, 0).breaks
        laws = getattr(solution.model.bodies[0], "material", None)
        jumps = made.axis.breaks[1:-1].tolist() if isinstance(laws, list) and len(made.rings) == 2 else []
        knots = [u for u in choice.boundary_layers(made, None, jumps) if np.abs(even - u).min() > 1e-6 * even[-1]]
        fine = Space(made, elements, 6 if whole else 5, 0, section_degree=min(across + more, 8), knots=tuple(knots))
        fine = replace(fine, quadrature=str(choice.rule(fine)))
        number, better = solved(fine)
        references.append(number)
        stresses.append(stresses_at(seed, better))
        supports.append(carried(better))
    rough, exact = references
    works = (float(np.abs(one / exact - 1.0).max()) for one in (found, rough))
    error, apart = (max(one, off(those, supports[2])) for one, those in zip(works, supports[:2], strict=True))
    record = {"seed": seed, **told, "error": error, "estimate": estimate, "apart": apart}
    record["chosen"] = "elements" in on.chosen and "section_degree" in on.chosen
    there, near, best = stresses
    if best is not None and there is not None and near is not None and best.size:
        largest = np.linalg.norm(best, axis=(1, 2)).max()
        error, beside = (float(np.linalg.norm(one - best, axis=(1, 2)).max() / largest) for one in (there, near))
        record |= {"stress error": error, "stress estimate": stress, "stress apart": beside}
    return record


def carried(solution: Any) -> list[tuple[Array, float]]:
    """Return forces and moments of supports, and of what sizes errors of them are shares; none of modes."""
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
    found = [solution.stress(0, u[k], (np.cos(angle[k]), np.sin(angle[k]))) for k in range(u.size)]
    return np.array(found).reshape(-1, 3, 3)


def ratio(record: Mapping[str, Any], apart: float, of: str = "") -> float | None:
    """Return error over estimate; None where it is not counted, the references being further apart than a share.

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


def shares(ratios: Sequence[float | None]) -> dict[str, Any]:
    """Return how many ratios count, the share within a factor of 3, and how far errors are above and below."""
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


def silent(records: Sequence[Mapping[str, Any]]) -> list[Any]:
    """Return the seeds of those on chosen spaces that are off by too much, for sure, without a warning."""
    found = []
    for record in (one for one in records if one["chosen"]):
        for of, large, told in (("", LARGE, LARGE), ("stress ", LARGE_STRESS, WARNED_STRESS)):
            error, estimate = record.get(f"{of}error", 0.0), record.get(f"{of}estimate") or 0.0
            if error - record.get(f"{of}apart", 0.0) > large and estimate <= told:
                found.append(record["seed"])
    return found


def main(arguments: Sequence[str]) -> int:
    """Run as many as are asked for."""
    options.initialize([])
    records = []
    for seed in range(*map(int, arguments or ["200"])):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                records.append(compare(seed))
        except (InputError, SolveError) as problem:
            print(results.line({"seed": seed, "failure": str(problem)}), flush=True)
            continue
        print(results.line(records[-1]), flush=True)
    for apart in APART:
        for of in ("", "stress "):
            told = shares([ratio(one, apart, of) for one in records])
            chosen = shares([ratio(one, apart, of) for one in records if one["chosen"]])
            print(results.line({"of": of or "work, frequencies", "apart": apart, "all": told, "chosen": chosen}))
    print(results.line({"chosen": sum(one["chosen"] for one in records), "silent": silent(records)}))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
