"""The ``isorod`` command."""

import argparse
import dataclasses
import difflib
import os
import sys
import types
import typing
import warnings
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, NoReturn

from isorod import __version__, options, scenes
from isorod.errors import InputError, SolveError

_EPILOG = "Options with a single dash go to PETSc untouched (-snes_monitor, -ksp_type gmres, -log_view, -help ...)."


class _Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message} (see {self.prog} --help)")

    def known(self, arguments: Sequence[str]) -> argparse.Namespace:
        """Parse, and name what is not known together with the nearest option there is."""
        found, unknown = self.parse_known_args(arguments)
        if unknown:
            word = unknown[0].split("=")[0]
            names = [name for action in self._actions for name in action.option_strings]
            near = difflib.get_close_matches(word, names, 1)
            self.error(f"option {word} is not known" + (f"; did you mean {near[0]}?" if near else ""))
        return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code: 0, or 2 with one line on standard error."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    warnings.showwarning = _show_warning
    try:
        return _dispatch(arguments)
    except (InputError, SolveError) as problem:
        if _rank() == 0:
            print(f"isorod: {problem}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def _dispatch(arguments: Sequence[str]) -> int:
    ours, theirs = options.split(arguments)
    parser = _Parser(prog="isorod", description="Rods as full 3-D continua through surface control points.")
    parser.add_argument("--version", action="version", version=f"isorod {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=_Parser)
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
    values = {field.name: getattr(found, field.name) for field in dataclasses.fields(scene_type)}
    folder = None
    if found.output is not None:
        from isorod import results

        folder = results.output_folder(found.output)
    scene = scene_type(**values)
    if scene.analysis == "geometry":
        if theirs:
            raise InputError(f"option {theirs[0]}: scene {name} is geometry only and uses no PETSc")
        record = {"scene": name, "analysis": "geometry", **_geometry(scene), "options": values}
    else:
        record = _analysis(name, scene, values, theirs, found, folder)
    if _rank() == 0:
        _report(record, found.json, folder)
    return 0


def _scene_parser(name: str, scene_type: Any) -> _Parser:
    parser = _Parser(prog=f"isorod run {name}", description=_first_line(scene_type), epilog=_EPILOG, allow_abbrev=False)
    for field in dataclasses.fields(scene_type):
        kind: Any = field.type
        if isinstance(kind, types.UnionType):
            kind = typing.get_args(kind)[0]
        shown = field.metadata["help"] + ("" if field.default is None else f" ({field.default})")
        flag = "--" + field.name.replace("_", "-")
        parser.add_argument(flag, dest=field.name, type=kind, default=field.default, metavar=kind.__name__, help=shown)
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
    folder: Path | None,
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
    if folder is not None and _rank() == 0:
        from isorod import export

        for k, body in enumerate(model.bodies):
            export.write(body, model.nodal(solution.displacement, k), folder / f"{name}-{k}.vtu")
    return record


def _report(record: dict[str, Any], as_json: bool, folder: Path | None) -> None:
    if folder is not None:
        from isorod import results

        results.append(folder / "results.jsonl", record)
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
        return 0
    from petsc4py import PETSc

    return int(PETSc.COMM_WORLD.getRank())


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    if _rank() == 0:
        print(f"isorod: warning: {message}", file=sys.stderr)
