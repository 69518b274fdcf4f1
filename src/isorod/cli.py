"""The ``isorod`` command."""

import argparse
import os
import sys
import warnings
from collections.abc import Sequence
from time import perf_counter
from typing import Any

import numpy as np

from isorod import __version__, options, scenes
from isorod.errors import InputError, SolveError

_EPILOG = "Options with a single dash go to PETSc untouched (-snes_monitor, -ksp_type gmres, -log_view, -help ...)."


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code: 0, or 2 with one line on standard error."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    warnings.showwarning = _show_warning
    try:
        return _dispatch(arguments)
    except (InputError, SolveError) as problem:
        return _fail(str(problem))
    except MemoryError:
        return _fail("there is not enough memory for this; take fewer elements, section or quadrature points")
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def _fail(message: str) -> int:
    if _rank() == 0:
        print(f"isorod: {message}", file=sys.stderr)
    return 2


def _dispatch(arguments: Sequence[str]) -> int:
    ours, theirs = options.split(arguments)
    parser = options.Parser(prog="isorod", description="Rods as full 3-D continua through surface control points.")
    parser.add_argument("--version", action="version", version=f"isorod {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=options.Parser)
    run = commands.add_parser("run", help="run a scene", add_help=False)
    run.add_argument("rest", nargs=argparse.REMAINDER)
    commands.add_parser("list", help="list the scenes")
    commands.add_parser("doctor", help="show versions, what is missing and how to get it")
    found = parser.known(ours[:1]) if ours[:1] == ["run"] else parser.known(ours)
    if found.command == "run":
        return _run(ours[1:], theirs)
    if theirs:
        raise InputError(f"option {theirs[0]}: PETSc options go with 'isorod run SCENE'")
    if found.command == "list":
        for name in scenes.SCENES:
            scene = scenes.find(name)
            print(f"{name:10s} {scene.analysis:10s} {_first_line(scene)}")
        return 0
    if found.command == "doctor":
        from isorod import doctor

        return doctor.main()
    parser.print_help()
    return 0


def _run(ours: Sequence[str], theirs: Sequence[str]) -> int:
    if not ours or ours[0] in ("-h", "--help"):
        print("usage: isorod run SCENE [--option value ...] [-petsc_option value ...]\n")
        print("scenes: " + ", ".join(scenes.SCENES) + " ('isorod list' says what they are)\n" + _EPILOG)
        return 0
    name = ours[0]
    scene_type = scenes.find(name)
    found = _scene_parser(name, scene_type).known(ours[1:])
    values = options.fields(found, scene_type)
    if found.output is not None:
        from isorod import results

        results.check_folder(found.output)
    scene = scene_type(**values)
    # What overflows ends as a number that is not finite, and no such number is reported.
    with np.errstate(all="ignore"):
        if scene.analysis == "geometry":
            if theirs:
                raise InputError(f"option {theirs[0]}: scene {name} is geometry only and uses no PETSc")
            record = {"scene": name, "analysis": "geometry", **_geometry(scene), "options": values}
        else:
            with options.petsc_errors():
                record = _analysis(name, scene, values, theirs, found)
    if _rank() == 0:
        _report(record, found.json, found.output)
    return 0


def _scene_parser(name: str, scene_type: Any) -> options.Parser:
    parser = options.Parser(
        prog=f"isorod run {name}", description=_first_line(scene_type), epilog=_EPILOG, allow_abbrev=False
    )
    options.add_fields(parser, scene_type)
    if scene_type.analysis == "statics":
        parser.add_argument(
            "--load-steps", type=int, default=1, metavar="int", help="equal load steps to start with (1)"
        )
    parser.add_argument("--json", action="store_true", help="print the result as one line of JSON")
    parser.add_argument("--output", metavar="DIR", help="write the result (and fields as .vtu) into this folder")
    return parser


def _geometry(scene: Any) -> dict[str, Any]:
    rod = scene.rod()
    return {
        "smallest_jacobian": rod.check(),
        "volume": rod.volume(),
        "control_points": rod.distinct_control_points,
    }


def _analysis(
    name: str,
    scene: Any,
    values: dict[str, Any],
    theirs: Sequence[str],
    found: argparse.Namespace,
) -> dict[str, Any]:
    if found.load_steps < 1:
        raise InputError(f"load steps: got {found.load_steps}, need at least 1")
    begin = perf_counter()
    options.initialize(theirs)
    from isorod import results, statics
    from isorod.petsc import unused_options

    imported = perf_counter()
    model = scene.model()
    built = perf_counter()
    solution = statics.solve(model, found.load_steps)
    seconds = {"import": imported - begin, **solution.seconds}
    seconds["setup"] += built - imported
    seconds["total"] = perf_counter() - imported
    record = {
        "scene": name,
        "analysis": "statics",
        **scene.measure(solution),
        "dofs": model.dofs,
        "unknowns": model.unknowns,
        "newton_iterations": solution.newton_iterations,
        "load_steps": solution.load_steps,
        "cuts": solution.cuts,
        "residual_norms": solution.residual_norms,
        "quadrature": [str(body.space.rule) for body in model.bodies],
        "built": solution.built,
        "seconds": seconds,
        "options": values,
        "petsc_options": " ".join(theirs),
        "solver": solution.solver,
        "ranks": solution.ranks,
        **results.provenance(),
    }
    left = unused_options()
    if left:
        raise InputError(f"PETSc option {', '.join(left)}: nothing used it; check its spelling with -help")
    if found.output is not None and _rank() == 0:
        from isorod import export

        folder = results.make_folder(found.output)
        for k, body in enumerate(model.bodies):
            export.write(body, model.nodal(solution.displacement, k), folder / f"{name}-{k}.vtu")
    return record


def _report(record: dict[str, Any], as_json: bool, output: str | None) -> None:
    if output is not None:
        from isorod import results

        results.append(results.make_folder(output) / "results.jsonl", record)
    if as_json:
        from isorod import results

        print(results.line(record))
        return
    for key, value in record.items():
        if key == "seconds":
            value = ", ".join(f"{part} {time:.4f}" for part, time in value.items())
        elif key in ("options", "versions", "machine"):
            value = ", ".join(f"{part} {item}" for part, item in value.items())
        elif isinstance(value, list):
            value = ", ".join(f"{item:.3e}" if isinstance(item, float) else str(item) for item in value)
        print(f"{key.replace('_', ' '):18s} {value}")


def _first_line(scene_type: Any) -> str:
    return (scene_type.__doc__ or "").strip().splitlines()[0]


def _rank() -> int:
    if "petsc4py.PETSc" not in sys.modules:
        return int(os.environ.get("OMPI_COMM_WORLD_RANK", os.environ.get("PMI_RANK", "0")))
    from petsc4py import PETSc

    return int(PETSc.COMM_WORLD.getRank())


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    if _rank() == 0:
        print(f"isorod: warning: {message}", file=sys.stderr)
