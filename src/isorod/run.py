"""Running a scene: from its parameters to a solution and a record of it."""

from collections.abc import Mapping
from importlib import import_module
from time import perf_counter
from typing import Any

from isorod import results
from isorod.disk import Array
from isorod.errors import InputError

# What a record keeps of each kind of solution, besides what the scene measures.
KEPT = {
    "statics": ("newton_iterations", "load_steps", "cuts", "residual_norms"),
    "modal": ("residuals", "rigid", "below", "shift", "iterations"),
}


def solve(scene: Any, settings: Mapping[str, Any]) -> tuple[Any, dict[str, float]]:
    """Build a scene's model and solve it with its analysis; return the solution and the wall times.

    ``settings`` are keyword arguments of the analysis (`isorod.statics.solve`, `isorod.modal.solve`).  PETSc must be running.
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
        **{key: getattr(solution, key) for key in KEPT[scene.analysis]},
        "quadrature": [str(body.space.rule) for body in model.bodies],
        "built": solution.built,
        "seconds": dict(seconds),
        "solver": solution.solver,
        "ranks": solution.ranks,
        **results.provenance(),
    }


def fields(scene: Any, solution: Any) -> dict[str, Array]:
    """Return the fields of a solution by name, each a vector of all degrees of freedom."""
    if scene.analysis == "statics":
        return {"displacement": solution.displacement}
    return {f"mode_{k + 1}": vector for k, vector in enumerate(solution.vectors)}
