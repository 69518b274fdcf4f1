"""Running a scene: from its parameters to a solution and its record."""

import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from time import perf_counter
from typing import Any

from isorod.command import steps
from isorod.errors import InputError, SolveError
from isorod.output import results
from isorod.output.words import STRESS_ERROR

# Estimated error above which a result is warned of: the accuracy of the default discretisation.
LARGE = 0.005

# The same for stresses, if requested.
LARGE_STRESS = 0.01

# Operations of a factorisation, some ten seconds, from which a model is announced as large.
_LARGE_BAND = 5e10

# Local refinements at contact patches that are under-resolved, at most.
REFINEMENTS = 3


def solve(
    scene: Any, settings: Mapping[str, Any], begin: Callable[[Any], Any] | None = None
) -> tuple[Any, dict[str, float]]:
    """Build a scene's model and solve it with its analysis; return the solution and the wall times.

    PETSc must be running.

    Parameters
    ----------
    scene
        The scene.
    settings
        Keyword arguments of the analysis (`solve` of `isorod.statics`, `isorod.modal`, `isorod.dynamics`).
    begin
        Returns, of a model of statics or modes, a displacement to begin at, or None.
    """
    return solve_scene(scene, settings, begin)[1:]


def solve_scene(
    scene: Any, settings: Mapping[str, Any], begin: Callable[[Any], Any] | None = None
) -> tuple[Any, Any, dict[str, float]]:
    """Return the solution's scene, on spaces that resolve contact patches, and what `solve` returns."""
    from isorod import compiling
    from isorod.compiled import cofactors

    try:
        analysis = import_module(f"isorod.{scene.analysis}")
    except ImportError as problem:
        raise InputError(
            f"{scene.analysis} analysis: module {problem.name} is not installed (see 'isorod doctor')"
        ) from None
    compiling.NOTICE.shares = True
    # Numba takes half a second before the first function: not counted in the run.
    _ = cofactors.compiled
    # A scene file adds the place in the file to errors.
    with scene.locating():
        started = perf_counter()
        model = scene.model()
        built = perf_counter()
        if scene.analysis != "dynamics":
            _announce_large(model)
        start = None if begin is None else begin(model)
        if start is not None:
            settings = {**settings, "start": start}
        analyse = steps.solve if steps.are_open(scene, settings) else analysis.solve
        scene, solution = _solve_refined(scene, model, analyse, settings)
    seconds = dict(solution.seconds)
    seconds["setup"] += built - started
    # Verification is a part of the run, so its time counts.
    seconds["total"] = perf_counter() - started
    return scene, solution, seconds


def _solve_refined(scene: Any, model: Any, analyse: Callable[..., Any], settings: Mapping[str, Any]) -> Any:
    """Return a scene and the solution of its model, on locally refined spaces if contact patches are under-resolved.

    Each solve starts from the previous solution.  The warnings are those of the solution returned: of the last but one,
    and one more, where the last fails.
    """
    seen = scene
    solution, warned = _solve_and_record_warnings(analyse, model, settings)
    # A checkpoint has the state of one space.
    for _ in range(0 if settings.get("checkpoint") else REFINEMENTS):
        try:
            refined = scene.refined_at_contact(solution)
            if refined is None:
                break
            model = refined.model()
            if scene.analysis != "dynamics":
                settings = {**settings, "start": start_at(solution, model)}
            solution, warned = _solve_and_record_warnings(analyse, model, settings)
            seen = refined
        except (InputError, SolveError) as problem:
            warnings.warn(
                f"local refinement of small contact patches failed, results are without it: {problem}",
                stacklevel=3,
            )
            break
    for warning in warned:
        warnings.warn(str(warning.message), warning.category, stacklevel=3)
    return seen, solution


def _announce_large(model: Any) -> None:
    """Announce on standard error a model so large that its first iteration takes long."""
    sizes = [(3 * body.space.nodes, 3 * body.space.element_nodes.shape[1]) for body in model.bodies]
    # Operations of a band factorisation.
    if sum(dofs * functions**2 for dofs, functions in sizes) < _LARGE_BAND:
        return
    from petsc4py import PETSc

    if PETSc.COMM_WORLD.getRank() == 0:
        dofs, functions = max(sizes, key=lambda one: one[0] * one[1] ** 2)
        text = f"{dofs:,} degrees of freedom, {functions:,} of them in an element: each iteration takes long"
        print(f"isorod: {text}", file=sys.stderr, flush=True)


def _solve_and_record_warnings(
    analyse: Callable[..., Any], model: Any, settings: Mapping[str, Any]
) -> tuple[Any, list[Any]]:
    """Return a solution and its warnings."""
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        return analyse(model, **settings), warned


def start_at(solution: Any, model: Any) -> Any:
    """Return the displacement ``(dofs,)`` of an equilibrium, or of the one modes are about, projected on another model.

    The model has the same rods on other spaces.  None for modes about the undeformed state, and for friction over
    several load steps, whose history has to be repeated.
    """
    from numpy import concatenate

    from isorod.space.transfer import transfer

    state = getattr(solution, "equilibrium", solution)
    if state is None or (state.load_steps > 1 and any(one.friction for one in model.contacts)):
        return None
    old = state.model
    return concatenate(
        [
            transfer(old.nodal(state.displacement, b), one.space, other.space).ravel()
            for b, (one, other) in enumerate(zip(old.bodies, model.bodies, strict=True))
        ]
    )


def warn_of_embedded(scene: Any, solution: Any) -> None:
    """Warn of rods whose welded ends begin within the other body (`isorod.checks.embedded`)."""
    if not solution.model.ties:
        return
    from isorod.checks import embedded

    error, part = embedded.of(solution)
    if part is not None and error > LARGE:
        cure = (
            ""
            if part.wholly is None
            else ", or tie its outer surface in the place of its end, along = [{:.4g}, {:.4g}]"
        )
        text = (
            f"body {part.body} is within body {part.other} for {part.depth:.3g} from the end on that is welded to it, "
            f"and held at that end alone: this makes an error of about {100.0 * error:.2g} %; end it where it leaves "
            f"the other{cure.format(*part.wholly or ())}"
        )
        warnings.warn(text, stacklevel=2)


def estimate(solution: Any, stresses: bool = False) -> dict[str, Any]:
    """Return the error estimates of a record, the time alone where none is available; warn of large errors.

    Parameters
    ----------
    solution
        The solution.
    stresses
        Whether stresses are among the results.
    """
    if not hasattr(solution, "estimate"):
        return {}
    most = getattr(solution, "largest", None) or solution
    if hasattr(most, "displacement") and not most.displacement.any():
        warnings.warn("nothing loads or moves the model: it stays at rest", stacklevel=2)
    start = perf_counter()
    error, stress = solution.errors() if hasattr(solution, "errors") else (solution.estimate(), None)
    fields = {"error_estimate": error, STRESS_ERROR: stress}
    fields = {name: value for name, value in fields.items() if value is not None}
    if error is None and any(one.friction for one in solution.model.contacts):
        warnings.warn(
            "no error estimate: no finer space is available; check convergence with more elements",
            stacklevel=2,
        )
    if stresses and stress is not None and stress > LARGE_STRESS:
        warnings.warn(
            f"estimated stress error {100.0 * stress:.2g} % of the largest, farther from edges than the section is "
            f"wide: --tolerance {LARGE_STRESS} refines until it is met where a file measures stresses",
            stacklevel=2,
        )
    if error is not None and error > LARGE:
        cure, place = "--tolerance 5e-3 refines until it is met", getattr(solution, "coarsest", None)
        if (getattr(solution, "steps_error", None) or 0.0) > 0.5 * error:
            cure = "most of it by few load steps: take more with --load-steps"
        elif place is not None:
            cure = f"refine the rods, or the mesh, first of all near ({', '.join(f'{x + 0.0:.3g}' for x in place)})"
        warnings.warn(f"estimated error {100.0 * error:.2g} %: {cure}", stacklevel=2)
    return fields | {"estimate_seconds": perf_counter() - start}


def stress_estimate(solution: Any) -> dict[str, float]:
    """Return a record's estimate of the stress error alone."""
    stress = solution.errors().stress if hasattr(solution, "errors") else None
    return {} if stress is None else {STRESS_ERROR: stress}


def geometry(scene: Any) -> dict[str, Any]:
    """Return the record of a scene that is geometry only."""
    rods = scene.rods()
    return _scene(scene) | {
        "smallest_jacobian": min(rod.check() for rod in rods),
        "volume": sum(rod.volume() for rod in rods),
        "control_points": sum(rod.distinct_control_points for rod in rods),
        "deviation": _deviation(rods),
    }


def _deviation(rods: Sequence[Any]) -> list[dict[str, float]]:
    """Return the deviation of each rod from its input geometry."""
    return [rod.deviation._asdict() for rod in rods]


def record(
    scene: Any, solution: Any, seconds: Mapping[str, float], settings: Mapping[str, Any], petsc: Sequence[str] = ()
) -> dict[str, Any]:
    """Return the record of a solution.

    Parameters
    ----------
    scene, solution, seconds
        The scene, its solution and the wall times of the run, as `solve` returns them.
    settings
        Keyword arguments the analysis was given.
    petsc
        PETSc's options.
    """
    model = solution.model
    bodies = {}
    if model.solids:
        from isorod.fenics.groups import described

        bodies["solids"] = [described(one) for one in model.solids]
    return {
        **_scene(scene),
        **scene.measure(solution),
        **bodies,
        "dofs": model.dofs,
        "unknowns": model.unknowns,
        **solution.record(),
        "quadrature": [str(body.space.rule) for body in model.bodies],
        "deviation": _deviation([body.space.rod for body in model.bodies]),
        "discretisation": [body.discretisation for body in model.bodies],
        "built": solution.built,
        "seconds": dict(seconds),
        "solver": solution.solver,
        "ranks": solution.ranks,
        **results.provenance(),
        "settings": {name: value for name, value in settings.items() if name != "progress"},
        "petsc_options": " ".join(petsc),
    }


def refuse_unused() -> None:
    """Raise `InputError` if one of PETSc's options was not used."""
    from isorod.petsc.library import unused_options

    left = unused_options()
    if left:
        raise InputError(f"PETSc option {', '.join(left)}: nothing used it; check its spelling with -help")


def origin(scene: Any) -> dict[str, Any]:
    """Return a scene's description with versions, date and machine."""
    return {**_scene(scene), **results.provenance()}


def _scene(scene: Any) -> dict[str, Any]:
    """Return a scene's name, options, analysis and names."""
    names = {"names": scene.names} if scene.names else {}
    return {"scene": scene.name, **scene.options, "analysis": scene.analysis, **names}
