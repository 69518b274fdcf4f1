"""The ``isorod`` command."""

import argparse
import dataclasses
import sys
import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from time import perf_counter
from typing import Any

from isorod import __version__, files, options, scenes
from isorod.command import ending
from isorod.command.parser import Parser, add_fields, field_values, split
from isorod.errors import InputError

# Each body with its fields by name.
Fields = list[tuple[Any, dict[str, Any]]]

_EPILOG = "Options with a single dash go to PETSc untouched (-snes_monitor, -ksp_type gmres, -log_view, -help ...)."


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line; return the exit code, other than 0 with one line on standard error."""
    return ending.run("isorod", lambda: command(sys.argv[1:] if arguments is None else arguments))


def command(arguments: Sequence[str]) -> int:
    """Do what the first word says; return the exit code."""
    warnings.showwarning = _keep_warning
    _WARNINGS.clear()
    ours, theirs = split(arguments)
    if theirs and ours[:1] != ["run"]:
        raise InputError(f"option {theirs[0]}: PETSc options go with 'isorod run SCENE'")
    if ours and ours[0].startswith("--") and "run" in ours:
        raise InputError(f"option {ours[0]}: it goes behind the command: isorod run SCENE {ours[0]}")
    parser = Parser(prog="isorod", description="Rods as full 3-D continua through surface control points.")
    parser.add_argument("--version", action="version", version=f"isorod {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)
    run = commands.add_parser("run", help="run a scene, or a file that describes one", add_help=False)
    run.add_argument("rest", nargs=argparse.REMAINDER)
    compare = commands.add_parser(
        "compare", help="solve a scene by finite elements too, and tell errors and times", add_help=False
    )
    compare.add_argument("rest", nargs=argparse.REMAINDER)
    commands.add_parser("list", help="list the scenes")
    new = commands.add_parser("new", help="write a file to begin with")
    new.add_argument("name", nargs="?", default="my.toml", metavar="NAME.toml", help="name of the file (my.toml)")
    new.add_argument("--from", default="starter", dest="origin", metavar="EXAMPLE", help="spring, ring ... (starter)")
    commands.add_parser("compile", help="compile everything ahead, so that no run has to wait for it")
    commands.add_parser("doctor", help="show versions, what is missing and how to get it")
    found = parser.known(ours[:1]) if ours[:1] in (["run"], ["compare"]) else parser.known(ours)
    if found.command == "run":
        return _run(ours[1:], theirs)
    if found.command == "compare":
        from isorod.command import compare as both

        return both.main(ours[1:])
    if found.command == "list":
        for name in scenes.SCENES:
            scene = scenes.find(name)
            print(f"{name:10s} {scenes.analyses(scene)[0]:10s} {_first_line(scene)}")
        return 0
    if found.command == "new":
        from isorod.command import new as starter

        return starter.main(found.name, found.origin)
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
    import numpy as np

    from isorod.command import printing

    if ours[:1] in (["-h"], ["--help"]) or not (ours or theirs):
        print("usage: isorod run SCENE [--option value ...] [-petsc_option value ...]\n")
        print("scenes: " + ", ".join(scenes.SCENES) + " ('isorod list' says what they are), or a file NAME.toml")
        print("('isorod new' writes one to begin with)\n" + _EPILOG)
        return 0
    place, scene, parser = _find_scene(ours, theirs)
    found = parser.known([*ours[:place], *ours[place + 1 :]])
    scene = _told(scene, found)
    if found.output is not None:
        from isorod.output import results, vtk

        results.check_folder(found.output)
        if scenes.analyses(scene) != ("geometry",):
            vtk.require()
    solve = _geometry if scene.analysis == "geometry" else _analysis
    # What overflows ends as a number that is not finite, and no such number is reported.
    with printing.apart() if found.json else nullcontext(), np.errstate(all="ignore"), options.petsc_errors():
        record, fields = solve(scene, theirs, found)
    if ending.rank() == 0:
        print(_report(record, fields, found, scene))
    return 0


def _find_scene(ours: Sequence[str], theirs: Sequence[str]) -> tuple[int, Any, Parser]:
    """Return where the scene's name stands, also behind options, its class or the scene of a file, and its parser.

    A name that is the value of an option before it is not meant.
    """
    for place, word in enumerate(ours):
        if (place == 0 and not word.startswith("-")) or _is_scene(word):
            scene = files.find(word)
            parser = _scene_parser(word, scene)
            if place == 0 or not parser.takes_value(ours[place - 1]):
                return place, scene, parser
    taken = next((k for k in range(1, len(theirs)) if _is_scene(theirs[k])), None)
    if taken is not None:
        raise InputError(
            f"no scene is named: {theirs[taken]} was taken for the value of {theirs[taken - 1]}; put it first: "
            f"isorod run {theirs[taken]} {theirs[taken - 1]}"
        )
    names = ", ".join(scenes.SCENES)
    raise InputError(f"no scene is named; there are: {names}; put one first: isorod run SCENE {[*ours, *theirs][0]}")


def _told(scene: Any, found: argparse.Namespace) -> Any:
    """Return the scene of a class, or that of a file, with the options that were typed."""
    if isinstance(scene, type):
        return scene(**field_values(found, scene))
    names = {field.name for field in dataclasses.fields(scene)}
    typed = {name: value for name, value in vars(found).items() if name in names and value is not None}
    return dataclasses.replace(scene, **typed) if typed else scene


def _is_scene(word: str) -> bool:
    return word in scenes.SCENES or (word.endswith(".toml") and not word.startswith("-"))


def _scene_parser(name: str, scene: Any) -> Parser:
    """Return the parser of the fields of a scene class, or of a file's scene, and of what its analyses can be told."""
    said = _first_line(scene) if isinstance(scene, type) else scene.title
    parser = Parser(prog=f"isorod run {name}", description=said, epilog=_EPILOG, allow_abbrev=False)
    if isinstance(scene, type) or scene.analysis != "geometry":
        add_fields(parser, scene)
    analyses = scenes.analyses(scene)
    if "statics" in analyses:
        steps = getattr(scene, "load_steps", 1)
        parser.add_argument(
            "--load-steps", type=int, default=steps, metavar="int", help=f"equal load steps to start with ({steps})"
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
        parser.add_argument(
            "--resume",
            action="store_true",
            help="continue the run whose state is in the checkpoint, to a later end time too with more outputs",
        )
    if "statics" in analyses or "modal" in analyses:
        parser.add_argument("--refine", action="store_true", help="solve on finer spaces too and estimate the error")
        parser.add_argument(
            "--tolerance",
            type=float,
            metavar="float",
            help="refine until the relative error is estimated to be below this",
        )
        parser.add_argument(
            "--no-estimate", action="store_true", help="leave out the estimate of the error, which takes as long again"
        )
    parser.add_argument("--json", action="store_true", help="print the result as one line of JSON")
    parser.add_argument("--output", metavar="DIR", help="write the result (and fields as .vtu) into this folder")
    if not isinstance(scene, type):
        # What is not typed is as the file says.
        parser.set_defaults(load_steps=None, modes=None, mass=None, integrator=None)
    return parser


def _settings(scene: Any, found: argparse.Namespace) -> dict[str, Any]:
    """Return the keyword arguments of the scene's analysis: what is typed before what a file says."""
    told = scene.analysis == "dynamics" or hasattr(scene, "content")
    own = scene.settings() if told else {}
    typed: dict[str, Any]
    if scene.analysis == "modal":
        typed = {"modes": found.modes, "lumped": found.mass and found.mass == "lumped"}
    elif scene.analysis == "dynamics":
        own |= {"checkpoint": found.checkpoint, "every": found.checkpoint_every, "resume": found.resume}
        own |= {"progress": True}
        typed = {"integrator": found.integrator}
    else:
        if found.load_steps is not None and found.load_steps < 1:
            raise InputError(f"load steps: got {found.load_steps}, need at least 1")
        typed = {"load_steps": found.load_steps}
    return own | {name: value for name, value in typed.items() if value is not None}


def _geometry(scene: Any, theirs: Sequence[str], found: argparse.Namespace) -> tuple[dict[str, Any], Fields]:
    if theirs:
        raise InputError(f"option {theirs[0]}: this scene is geometry only and uses no PETSc")
    from isorod.command import run

    return run.geometry(scene), []


def _analysis(scene: Any, theirs: Sequence[str], found: argparse.Namespace) -> tuple[dict[str, Any], Fields]:
    """Solve a scene; return its record, and the fields of each body."""
    begin = perf_counter()
    options.initialize(theirs)
    # Those of a file are held to the analysis, which starts PETSc.
    settings = _settings(scene, found)
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
        if not getattr(found, "no_estimate", True):
            refined = run.estimate(solution)
    record = run.record(scene, solution, {"import": imported} | seconds, settings, theirs) | refined
    left = unused_options()
    if left:
        raise InputError(f"PETSc option {', '.join(left)}: nothing used it; check its spelling with -help")
    return record, [(body, solution.fields(k)) for k, body in enumerate(solution.model.bodies)]


def _report(record: dict[str, Any], fields: Fields, found: argparse.Namespace, scene: Any) -> str:
    """Write the record and the fields where they are wanted; return the record as JSON or in words."""
    from isorod.command import printing
    from isorod.output import results

    # Before anything is written: a record that cannot be one is an error.
    text = results.line(record)
    if found.output is not None:
        from isorod.output import folder

        record = folder.add(results.make_folder(found.output), record, fields)
        text = results.line(record)
    _show_warnings()
    return text if found.json else printing.summary(record, scene)


def _first_line(scene_type: Any) -> str:
    return (scene_type.__doc__ or "").strip().splitlines()[0]


# Until there is a result: an error is said alone.
_WARNINGS: list[str] = []


def _keep_warning(message: Warning | str, *_: object, **__: object) -> None:
    _WARNINGS.append(" ".join(str(message).split()))


def _show_warnings() -> None:
    for text in _WARNINGS:
        print(f"isorod: warning: {text}", file=sys.stderr)
