"""Running a scene: from its parameters to a solution and a record of it."""

from collections.abc import Mapping
from importlib import import_module
from time import perf_counter
from typing import Any

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.output import results

# What a record keeps of each kind of solution, besides what the scene measures.
KEPT = {
    "statics": ("newton_iterations", "linear_iterations", "load_steps", "cuts", "residual_norms"),
    "modal": ("residuals", "rigid", "below", "shift", "iterations"),
    "dynamics": (
        "times",
        "reactions",
        "contact_force",
        "contact_area",
        "penetration",
        "kinetic",
        "stored",
        "contact_energy",
        "added_kinetic",
        "muscle_work",
        "dissipated",
        "energy_error",
        "momentum_error",
        "steps",
        "time_step",
        "added_kinetic_share",
        "critical_step",
        "microseconds_a_step",
        "newton_iterations",
        "cuts",
        "resumed",
    ),
}


def solve(scene: Any, settings: Mapping[str, Any]) -> tuple[Any, dict[str, float]]:
    """Build a scene's model and solve it with its analysis; return the solution and the wall times.

    ``settings`` are keyword arguments of the analysis (`solve` of `isorod.statics`, `isorod.modal`, `isorod.dynamics`).
     PETSc must be running.
    """
    try:
        analysis = import_module(f"isorod.{scene.analysis}")
    except ImportError as problem:
        raise InputError(
            f"{scene.analysis} analysis: module {problem.name} is not installed (see 'isorod doctor')"
        ) from None
    start = perf_counter()
    model = scene.model()
    built = perf_counter()
    solution = analysis.solve(model, **settings)
    seconds = dict(solution.seconds)
    seconds["setup"] += built - start
    # What proves a result, beyond finding it, stays out of the total.
    seconds["total"] = perf_counter() - start - seconds.get("check", 0.0)
    return solution, seconds


def geometry(scene: Any) -> dict[str, Any]:
    """Return the record of a scene that is geometry only."""
    rod = scene.rod()
    return {
        "analysis": scene.analysis,
        "smallest_jacobian": rod.check(),
        "volume": rod.volume(),
        "control_points": rod.distinct_control_points,
    }


def record(scene: Any, solution: Any, seconds: Mapping[str, float]) -> dict[str, Any]:
    """Return the record of a solution."""
    model = solution.model
    return {
        "analysis": scene.analysis,
        **scene.measure(solution),
        "dofs": model.dofs,
        "unknowns": model.unknowns,
        **_pressures(model),
        **{key: getattr(solution, key) for key in KEPT[scene.analysis]},
        **_contact(solution),
        "quadrature": [str(body.space.rule) for body in model.bodies],
        "built": solution.built,
        "seconds": dict(seconds),
        "solver": solution.solver,
        "ranks": solution.ranks,
        **results.provenance(),
    }


def _contact(solution: Any) -> dict[str, float]:
    """Return the area in contact and the deepest penetration of an equilibrium, all contacts together; nothing where it has none."""
    found = getattr(solution, "contacts", ())
    if not found:
        return {}
    return {"contact_area": sum(one.area for one in found), "penetration": max(one.penetration for one in found)}


def _pressures(model: Any) -> dict[str, int]:
    count = sum(body.pressures.size for body in model.bodies if body.pressures is not None)
    return {"pressures": count} if count else {}


def fields(scene: Any, solution: Any) -> dict[str, Array]:
    """Return the fields of a solution by name, each a vector of all degrees of freedom."""
    if scene.analysis == "statics":
        return {"displacement": solution.displacement}
    if scene.analysis == "dynamics":
        return {"displacement": solution.displacement[-1], "velocity": solution.velocity[-1]}
    return {f"mode_{k + 1}": vector for k, vector in enumerate(solution.vectors)}
