"""``python -m comparisons.fem spring --cells bricks --degree 2 [-ksp_type cg ...]``: one run, one JSON line."""

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from comparisons.fem import presets
from comparisons.fem.arguments import add_options, positive
from isorod import options
from isorod.command import ending
from isorod.command.parser import Parser, split
from isorod.errors import InputError
from isorod.fenics.flags import FAST
from isorod.output import results
from isorod.scenes.biceps import Biceps

PRESETS = {name: import_module(f"{presets.__name__}.{name}").PRESETS for name in ("spring", "blade", "biceps")}

ABOUT = {
    "spring": "the helical spring, pulled",
    "blade": "the blade's vibration modes",
    "biceps": "the biceps' equilibrium, or its motion",
    "rods": "any scene of isorod's: its name, or that of a .toml file",
}

# The configuration of each scene, in the module that has its run().
RUNS = {
    "spring": "published.Spring",
    "blade": "published.Blade",
    "biceps": "biceps.run.Configuration",
    "rods": "rods.run.Configuration",
}

# Fields that scenes write.
FIELDS = {
    "biceps": "write nodes, positions and cells to this .npz file",
    "rods": "write nodes, displacements or modes, stress to this .npz file",
}

# Parameters of the biceps that are options here too.
BICEPS = ("activation", "nu", "penalty", "fibre", "ramp", "damping", "end_time", "outputs")


def _runner(scene: str) -> tuple[Any, Any]:
    """Return the module that runs a scene, and the class of its configuration."""
    place, _, kind = RUNS[scene].rpartition(".")
    module = import_module(f"comparisons.fem.{place}")
    return module, getattr(module, kind)


def _parser(scene: str) -> argparse.ArgumentParser:
    """Return the parser with the options of one scene: only that scene's modules are loaded."""
    parser = Parser(
        prog="comparisons.fem",
        description="Finite element reference solutions with dolfinx. Options with a single dash go to PETSc.",
    )
    scenes = parser.add_subparsers(dest="scene", required=True, metavar="SCENE", help="spring, blade, biceps or rods")
    for name, about in ABOUT.items():
        subparser = scenes.add_parser(name, help=about)
        if name == scene:
            _add_options(subparser, name)
    return parser


def _add_options(parser: argparse.ArgumentParser, scene: str) -> None:
    if scene in PRESETS:
        parser.add_argument(
            "--preset", choices=PRESETS[scene], help="start from a configuration; other options change it"
        )
    if scene == "rods":
        parser.add_argument("name", metavar="NAME", help="scene or file")
    add_options(parser, _runner(scene)[1])
    for field in dataclasses.fields(Biceps) if scene == "biceps" else ():
        if field.name in BICEPS:
            name = f"--{field.name.replace('_', '-')}"
            parser.add_argument(name, type=type(field.default), default=field.default, help=field.metadata["help"])
    if scene in FIELDS:
        parser.add_argument("--fields", metavar="FILE", help=FIELDS[scene])
    # Those of the biceps suit the analysis.
    flags = "" if scene == "biceps" else " ".join(FAST)
    parser.add_argument("--flags", default=flags, help="C compiler flags, one word: --flags='-O2'")
    parser.add_argument(
        "--repeat", type=positive, default=1, metavar="N", help="runs in this process, the first one cold"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    # Long calls of dolfinx and PETSc let no exception through until they return.
    return ending.run("comparisons.fem", lambda: _main(words), at_once=True)


def _main(arguments: Sequence[str]) -> int:
    ours, petsc = split(arguments)
    # Before the modules of a scene, whose options the parser has, start MPI.
    options.initialize(petsc)
    parser = _parser(ours[0] if ours else "")
    given = vars(parser.parse_args(ours))
    preset = given.pop("preset", None)
    if preset:
        # Behind the scene's name and before what was typed, which then wins.
        given = vars(parser.parse_args([ours[0], *PRESETS[ours[0]][preset].split(), *ours[1:]]))
        del given["preset"]
    record = _run(given)
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        print(results.line(record), flush=True)
    return 0


def _run(given: dict[str, Any]) -> dict[str, Any]:
    from isorod.petsc.library import unused_options

    name = given.pop("scene")
    scene, configuration = _runner(name)
    repeat, file = given.pop("repeat"), given.pop("fields", None)
    given["flags"] = tuple(given["flags"].split())
    if name == "biceps":
        given["scene"] = Biceps(**{name: given.pop(name) for name in BICEPS})
    with options.petsc_errors():
        record: dict[str, Any] = scene.run(configuration(**given), repeat, *([Path(file)] if file else []))
    unknown = unused_options()
    if unknown:
        raise InputError(f"PETSc option {', '.join(unknown)}: nothing used it; check its spelling with -help")
    return record


if __name__ == "__main__":
    sys.exit(main())
