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
from isorod.command.parser import Parser, add_fields, field_values, split
from isorod.errors import InputError, SolveError

# Each body with its fields by name.
Fields = list[tuple[Any, dict[str, Any]]]

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
        # What is quoted of the input may have line ends.
        print(f"isorod: {' '.join(message.split())}", file=sys.stderr)
    return 2


def _dispatch(arguments: Sequence[str]) -> int:
    """Do what the first word says; return the exit code."""
    ours, theirs = split(arguments)
    parser = Parser(prog="isorod", description="Rods as full 3-D continua through surface control points.")
    parser.add_argument("--version", action="version", version=f"isorod {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)
    run = commands.add_parser("run", help="run a scene", add_help=False)
    run.add_argument("rest", nargs=argparse.REMAINDER)
    commands.add_parser("list", help="list the scenes")
    commands.add_parser("compile", help="compile everything ahead, so that no run has to wait for it")
    commands.add_parser("doctor", help="show versions, what is missing and how to get it")
    found = parser.known(ours[:1]) if ours[:1] == ["run"] else parser.known(ours)
    if found.command == "run":
        return _run(ours[1:], theirs)
    if theirs:
        raise InputError(f"option {theirs[0]}: PETSc options go with 'isorod run SCENE'")
    if found.command == "list":
        for name in scenes.SCENES:
            scene = scenes.find(name)
            print(f"{name:10s} {scenes.analyses(scene)[0]:10s} {_first_line(scene)}")
        return 0
    if found.command == "compile":
        from isorod.command import compile as ahead

        return ahead.main()
    if found.command == "doctor":
        from isorod.command import doctor

        return doctor.main()
    parser.print_help()
    return 0


def _run(ours: Sequence[str], theirs: Sequence[str]) -> int:
    """Run a scene with our options and PETSc's; return the exit code."""
    if not ours or ours[0] in ("-h", "--help"):
        print("usage: isorod run SCENE [--option value ...] [-petsc_option value ...]\n")
        print("scenes: " + ", ".join(scenes.SCENES) + " ('isorod list' says what they are)\n" + _EPILOG)
        return 0
    name = ours[0]
    scene_type = scenes.find(name)
    found = _scene_parser(name, scene_type).known(ours[1:])
    values = field_values(found, scene_type)
    if found.output is not None:
        from isorod.output import results, vtk

        results.check_folder(found.output)
        if scenes.analyses(scene_type) != ("geometry",):
            vtk.require()
    scene = scene_type(**values)
    # What overflows ends as a number that is not finite, and no such number is reported.
    with np.errstate(all="ignore"), options.petsc_errors():
        record, fields = _geometry(scene, theirs) if scene.analysis == "geometry" else _analysis(scene, theirs, found)
    if _rank() == 0:
        _report(record, fields, found)
    return 0


def _scene_parser(name: str, scene_type: Any) -> Parser:
    """Return the parser of a scene's fields and of what its analyses can be told."""
    parser = Parser(prog=f"isorod run {name}", description=_first_line(scene_type), epilog=_EPILOG, allow_abbrev=False)
    add_fields(parser, scene_type)
    analyses = scenes.analyses(scene_type)
    if "statics" in analyses:
        parser.add_argument(
            "--load-steps", type=int, default=1, metavar="int", help="equal load steps to start with (1)"
        )
    if "modal" in analyses:
        parser.add_argument("--modes", type=int, default=10, metavar="int", help="modes besides rigid ones (10)")
        parser.add_argument(
            "--mass",
            choices=("consistent", "lumped"),
            default="consistent",
            help="mass matrix (consistent); lumped is right for bending, not for torsion",
        )
    if "dynamics" in analyses:
        parser.add_argument(
            "--integrator",
            choices=("explicit", "implicit"),
            default="explicit",
            help="steps in time (explicit); implicit ones may be of any length",
        )
        parser.add_argument("--checkpoint", metavar="FILE", help="keep the state of the run in this file")
        parser.add_argument(
            "--checkpoint-every",
            type=float,
            default=30.0,
            metavar="float",
            help="seconds of run time between checkpoints (30)",
        )
        parser.add_argument("--resume", action="store_true", help="continue the run whose state is in the checkpoint")
    if "statics" in analyses or "modal" in analyses:
        parser.add_argument("--refine", action="store_true", help="solve on finer spaces too and estimate the error")
        parser.add_argument(
            "--tolerance",
            type=float,
            metavar="float",
            help="refine until the relative error is estimated to be below this",
        )
    parser.add_argument("--json", action="store_true", help="print the result as one line of JSON")
    parser.add_argument("--output", metavar="DIR", help="write the result (and fields as .vtu) into this folder")
    return parser


def _settings(scene: Any, found: argparse.Namespace) -> dict[str, Any]:
    """Return the keyword arguments of the scene's analysis."""
    if scene.analysis == "modal":
        return {"modes": found.modes, "lumped": found.mass == "lumped"}
    if scene.analysis == "dynamics":
        keep = {"checkpoint": found.checkpoint, "every": found.checkpoint_every, "resume": found.resume}
        keep["integrator"] = found.integrator
        return scene.settings() | keep | {"progress": True}
    if found.load_steps < 1:
        raise InputError(f"load steps: got {found.load_steps}, need at least 1")
    return {"load_steps": found.load_steps}


def _geometry(scene: Any, theirs: Sequence[str]) -> tuple[dict[str, Any], Fields]:
    if theirs:
        raise InputError(f"option {theirs[0]}: this scene is geometry only and uses no PETSc")
    from isorod.command import run

    return run.geometry(scene), []


def _analysis(scene: Any, theirs: Sequence[str], found: argparse.Namespace) -> tuple[dict[str, Any], Fields]:
    """Solve a scene; return its record, and the fields of each body."""
    settings = _settings(scene, found)
    begin = perf_counter()
    options.initialize(theirs)
    from isorod.command import run
    from isorod.petsc.library import unused_options

    imported = perf_counter() - begin
    refined: dict[str, Any] = {}
    if getattr(found, "refine", False) or getattr(found, "tolerance", None) is not None:
        if scene.analysis == "dynamics":
            raise InputError("--refine and --tolerance: not for dynamics; compare runs with other elements and orders")
        from isorod.command.refine import estimate

        reached = estimate(scene, settings, found.tolerance)
        scene, solution, seconds = reached.scene, reached.solution, reached.seconds
        refined = {"error_estimate": reached.error, "changes": reached.changes, "refinements": reached.history}
    else:
        solution, seconds = run.solve(scene, settings)
    record = run.record(scene, solution, {"import": imported} | seconds, settings, theirs) | refined
    left = unused_options()
    if left:
        raise InputError(f"PETSc option {', '.join(left)}: nothing used it; check its spelling with -help")
    return record, [(body, solution.fields(k)) for k, body in enumerate(solution.model.bodies)]


def _report(record: dict[str, Any], fields: Fields, found: argparse.Namespace) -> None:
    """Write the record and the fields where they are wanted, and print the record as JSON or for people."""
    from isorod.output import results

    # Before anything is written: a record that cannot be one is an error.
    text = results.line(record)
    if found.output is not None:
        from isorod.output import vtk

        folder = results.make_folder(found.output)
        for k, (body, nodal) in enumerate(fields):
            vtk.write(body, nodal, folder / f"{record['scene']}-{k}.vtu")
        results.append(folder / "results.jsonl", record)
    if found.json:
        print(text)
        return
    for key, value in record.items():
        if key == "seconds":
            value = ", ".join(f"{part} {time:.4f}" for part, time in value.items())
        elif key in ("options", "settings", "solver", "versions", "machine", "changes"):
            value = ", ".join(f"{part} {item}" for part, item in value.items())
        elif "times" in record and isinstance(value, np.ndarray) and value.shape[:1] == record["times"].shape:
            key, value = f"{key} (end)", ", ".join(f"{item:.6g}" for item in value[-1].ravel())
        elif isinstance(value, list | np.ndarray):
            value = ", ".join(f"{item:.6g}" if isinstance(item, float) else str(item) for item in value)
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
        print(f"isorod: warning: {' '.join(str(message).split())}", file=sys.stderr)
