"""``isorod run``: solves a scene, prints its record and writes its results."""

import argparse
import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from time import perf_counter
from typing import TYPE_CHECKING, Any

from isorod import memory, options, scenes
from isorod.command import chosen, ending, notes
from isorod.command.parser import Parser
from isorod.errors import InputError
from isorod.output.words import CELLS

if TYPE_CHECKING:
    from isorod.arrays import Array


def main(ours: Sequence[str], theirs: Sequence[str]) -> int:
    """Run a scene with our options and PETSc's; return the exit code."""
    import numpy as np

    from isorod.command import printing

    if chosen.usage("run", ours, theirs):
        return 0
    scene, args, _ = chosen.choose("run", ours, theirs, more)
    if args.output is not None:
        from isorod.output import results, vtk

        results.check_folder(args.output)
        if scenes.analyses(scene) != ("geometry",):
            vtk.require()
    if scene.cases and scene.case is None:
        from isorod.command import cases

        return cases.run(scene, theirs, args, _analysis, _kept)
    solve = _geometry if scene.analysis == "geometry" else _analysis
    # Overflow gives numbers that are not finite, which are refused before they are reported.
    with printing.apart() if args.json else nullcontext(), np.errstate(all="ignore"), options.petsc_errors():
        record, solution = solve(scene, theirs, args)
    problems = [record["short"]] if "short" in record else []
    if ending.rank() == 0:
        text, lost = _report(record, solution, args, scene)
        problems += [lost] if lost else []
        print(text, flush=bool(problems))
    # The result of a long run has been printed, whatever else failed.
    return ending.fail("isorod", "; ".join(problems)) if problems else 0


def more(parser: Parser, scene: Any) -> None:
    """Add options of the scene's analyses, and of their output."""
    chosen.with_analysis(parser, scene)
    analyses = scenes.analyses(scene)
    kept = bool({"dynamics", "statics"} & {*analyses})
    if not kept:
        motions = "only statics and dynamics can be restarted"
        parser.elsewhere |= dict.fromkeys(("--checkpoint", "--checkpoint-every", "--resume"), motions)
    if analyses == ("dynamics",):
        error = "no error estimate in dynamics; compare runs with other elements and orders"
        parser.elsewhere |= dict.fromkeys(("--tolerance", "--no-estimate"), error)
    if kept:
        parser.add_argument("--checkpoint", metavar="FILE", help="write checkpoints of the run to this file")
        parser.add_argument(
            "--checkpoint-every",
            type=float,
            default=30.0,
            metavar="float",
            help="seconds of run time between checkpoints (30)",
        )
        parser.add_argument(
            "--resume",
            action="store_true",
            help="restart from the checkpoint; a later end time of a motion takes more outputs",
        )
    if {"statics", "modal", "buckling", "harmonic", "random"} & {*analyses}:
        parser.add_argument("--refine", action="store_true", help=argparse.SUPPRESS)
        parser.add_argument(
            "--tolerance",
            type=float,
            metavar="float",
            help="refine until the estimated relative error is below this",
        )
        parser.add_argument(
            "--no-estimate", action="store_true", help="skip the error estimate, which takes about as long as the run"
        )
    if {"statics", "modal"} & {*analyses}:
        parser.add_argument(
            "--derivatives",
            nargs="?",
            const="",
            metavar="NAME,...",
            help="derivatives of the results with respect to these numbers of the scene, or to all",
        )
    parser.add_argument("--json", action="store_true", help="print the result as one line of JSON")
    parser.add_argument(
        "--output", metavar="DIR", help="write the result, fields as .vtu and curves as .csv into this folder"
    )
    if analyses != ("geometry",):
        parser.add_argument(
            "--cells",
            type=_cells,
            choices=CELLS,
            default="auto",
            help="cells of these fields: curved, small linear ones, or chosen for each body (auto)",
        )


def _cells(text: str) -> str:
    """Return the kind of cells by its name; the former name of curved ones is accepted."""
    if text == "bezier":
        warnings.warn("--cells bezier: renamed, use --cells curved", FutureWarning, stacklevel=2)
        return "curved"
    return text


def _geometry(scene: Any, theirs: Sequence[str], args: argparse.Namespace) -> tuple[dict[str, Any], None]:
    if theirs:
        raise InputError(f"option {theirs[0]}: this scene is geometry only and uses no PETSc")
    from isorod.command import solving

    return solving.geometry(scene), None


def _analysis(scene: Any, theirs: Sequence[str], args: argparse.Namespace) -> tuple[dict[str, Any], Any]:
    """Solve a scene; return its record, and the solution."""
    begin = perf_counter()
    options.initialize(theirs)
    names = _by(scene, getattr(args, "derivatives", None))
    # Settings of a file are checked by the analysis, whose import starts PETSc.
    settings = chosen.settings(scene, args)
    if scene.analysis == "dynamics" or getattr(args, "checkpoint", None) or getattr(args, "resume", False):
        settings |= {"checkpoint": args.checkpoint, "every": args.checkpoint_every, "resume": args.resume}
    settings |= {"progress": True}
    if scene.analysis == "statics" and args.output is not None:
        settings |= {"keep": True}
    from isorod.command import solving

    imported = perf_counter() - begin
    refined: dict[str, Any] = {}
    shown = bool(scene.stresses) or args.output is not None
    if getattr(args, "refine", False):
        warnings.warn("--refine: the error is estimated without it; leave it out", FutureWarning, stacklevel=2)
    if getattr(args, "tolerance", None) is not None:
        if scene.analysis == "dynamics":
            raise InputError("--tolerance: not for dynamics; compare runs with other elements and orders")
        if settings.get("checkpoint") is not None:
            raise InputError("--checkpoint: it is of one run, and --tolerance takes several; leave one out")
        from isorod.command.refine import refine

        scene, solution, seconds, error, history, short = refine(scene, settings, args.tolerance)
        seen = scene
        refined = {"error_estimate": error, "refinements": history} | ({"short": short} if short else {})
        refined |= solving.stress_estimate(solution) if shown else {}
    else:
        seen, solution, seconds = solving.solve_scene(scene, settings)
        if not getattr(args, "no_estimate", True):
            refined = solving.estimate(solution, shown)
    solving.warn_of_embedded(scene, solution)
    record = solving.record(scene, solution, {"import": imported} | seconds, settings, theirs) | refined
    if names is not None:
        from isorod.design import derivatives

        rates = derivatives.of(seen, solution, names, settings, ending.announce)
        record |= {"derivatives": rates.record(), "no_derivatives": dict(rates.none)}
        record |= {"differences": rates.why} if rates.why else {}
    solving.refuse_unused()
    return record, solution


def _by(scene: Any, text: str | None) -> dict[str, float] | None:
    """Return the parameters of the requested derivatives: None for none, all where no name is given."""
    if text is None:
        return None
    from isorod.design import derivatives, parameters

    derivatives.refuse(scene)
    if not text:
        return parameters.parameters(scene)
    return {name: value for one in text.split(",") for name, value in parameters.named(scene, one.strip()).items()}


def _report(record: dict[str, Any], solution: Any, args: argparse.Namespace, scene: Any) -> tuple[str, str]:
    """Write the requested record, fields and curves; return the record as JSON or text.

    The second text is why nothing could be written; empty if all is.
    """
    from isorod.command import printing
    from isorod.output import results

    # Before anything is written: a record that cannot be one is an error.
    text, lost = results.line(record), ""
    if args.output is not None:
        try:
            record = _kept(record, solution, args, scene)
        except (InputError, MemoryError) as problem:
            lost = str(problem) or memory.SHORT
        text = results.line(record)
    notes.show()
    if args.json:
        return text, lost
    words = [printing.summary(record, scene)]
    if "derivatives" in record:
        from isorod.command import rates

        words += rates.lines(record)
    return "\n".join(words), lost


def _kept(record: dict[str, Any], solution: Any, args: argparse.Namespace, scene: Any) -> dict[str, Any]:
    """Write the record, fields and curves into the results folder; return the record with the names of the files."""
    from isorod.output import folder, results

    with results.folder(args.output) as place:
        if solution is None:
            return folder.add(place, record, [], [])
        # A scene file has names for supports.
        curves = {scene.named(name): values for name, values in solution.curves().items()}
        curves |= _measured(scene, solution, record)
        model = solution.model
        # Bodies distributed over several ranks are not written.
        solids = [] if any(solid.comm.size > 1 for solid in model.solids) else model.solids
        return folder.add(place, record, model.bodies, folder.frames(solution), curves, args.cells, solids)


def _measured(scene: Any, solution: Any, record: dict[str, Any]) -> "dict[str, Array]":
    """Return results as curves: over the outputs of a motion, or over load steps (NaN for the unloaded state)."""
    import numpy as np

    if "times" in record:
        rows = {name: np.asarray(record[name]) for name in scene.units if name in record}
        rows = {name: arrays for name, arrays in rows.items() if arrays.shape[:1] == np.shape(record["times"])}
    elif scene.analysis == "statics" and scene.along:
        with warnings.catch_warnings():
            # The last state has issued its warnings already.
            warnings.simplefilter("ignore")
            each = [scene.measure(one, scene.along) for _, one in solution.frames() if hasattr(one, "reactions")]
        arrays = {name: np.array([np.asarray(one[name], dtype=float) for one in each]) for name in scene.along}
        rows = {name: np.append(np.full_like(one[:1], np.nan), one, axis=0) for name, one in arrays.items()}
    elif "response" in record:
        return swinging(scene, record["response"])
    else:
        rows = {}
    curves: dict[str, Array] = {}
    for name, values in rows.items():
        several = values.reshape(len(values), -1).T
        parts = "xyz" if len(several) == 3 else [str(k + 1) for k in range(len(several))]
        unit = f" ({scene.units[name].strip('()')})" if scene.units.get(name) else ""
        names = [f"{name}{unit}"] if values.ndim == 1 else [f"{name}[{k}]{unit}" for k in parts]
        curves |= dict(zip(names, several, strict=True))
    return curves


def swinging(scene: Any, response: Any) -> "dict[str, Array]":
    """Return amplitude and phase, or spectral density, of a scene's results, by names with their units."""
    curves: dict[str, Array] = {}
    for name, columns in response.items():
        unit = scene.units.get(name.partition("[")[0], "").strip("()")
        units = {"amplitude": f" ({unit})", "density": f" ({unit}^2 / frequency)"} if unit else {}
        curves |= {f"{name} {what}{units.get(what, '')}": values for what, values in columns.items()}
    return curves
