"""``python -m comparisons.fem spring --cells bricks --degree 2 [-ksp_type cg ...]``: one run, one JSON line."""

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from comparisons.fem import presets
from comparisons.fem.flags import FAST
from comparisons.fem.quadrature import RULES
from isorod import options
from isorod.command import ending
from isorod.command.parser import split
from isorod.errors import InputError
from isorod.model.body import FORMULATIONS
from isorod.output import results
from isorod.scenes.biceps import Biceps
from meshes import biceps, blade, spring

PRESETS = {name: import_module(f"{presets.__name__}.{name}").PRESETS for name in ("spring", "blade", "biceps")}

# What configures each scene, in the module that has its run().
RUNS = {
    "spring": "published.Spring",
    "blade": "published.Blade",
    "biceps": "biceps.run.Configuration",
    "rods": "rods.run.Configuration",
}

# Parameters of the biceps that are options here too.
BICEPS = ("activation", "nu", "penalty", "fibre", "ramp", "damping", "end_time", "outputs")


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise InputError(message)


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"got {value}, need at least 1")
    return value


def _rule(text: str) -> int | str:
    try:
        return text if text in RULES else int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}, need a degree or {' or '.join(RULES)}") from None


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="comparisons.fem",
        description="Finite element reference solutions with dolfinx. Options with a single dash go to PETSc.",
    )
    scenes = parser.add_subparsers(dest="scene", required=True, metavar="SCENE", help="spring, blade, biceps or rods")
    it = scenes.add_parser("spring", help="the helical spring, pulled")
    it.add_argument("--around", type=int, default=8, metavar="N", help="cells round the wire")
    it.add_argument("--layers", type=int, default=48, metavar="N", help="cells along the wire, a multiple of 12")
    it.add_argument("--rings", type=int, default=1, metavar="N", help="bricks: rings round the core")
    it.add_argument("--core", type=float, metavar="R", help="bricks: radius of the core's corners")
    it.add_argument("--fields", metavar="FILE", help="write displacement and von Mises stress to this .npz file")
    _add_common(it, "spring", spring.CELLS)
    it = scenes.add_parser("blade", help="the blade's vibration modes")
    it.add_argument("--along", type=int, default=6, metavar="N", help="cells along the chord")
    it.add_argument("--across", type=int, default=1, metavar="N", help="cells across the thickness")
    it.add_argument("--layers", type=int, default=12, metavar="N", help="cells from root to tip")
    it.add_argument(
        "--grading", type=float, default=1.0, metavar="G", help="layer k of N starts at (k / N)^G of the way"
    )
    it.add_argument("--clustering", type=float, default=1.0, metavar="C", help="0: cells equally long along the chord")
    it.add_argument("--modes", type=int, default=10, metavar="N", help="number of modes")
    it.add_argument("--modes-file", dest="fields", metavar="FILE", help="write the mode shapes to this .npz file")
    _add_common(it, "blade", blade.CELLS)
    _add_biceps(scenes.add_parser("biceps", help="the biceps' equilibrium, or its motion"))
    it = scenes.add_parser("rods", help="any scene of isorod's: its name, or that of a .toml file")
    it.add_argument("name", metavar="NAME", help="scene or file")
    it.add_argument("--level", type=_positive, default=1, metavar="L", help="cells in each direction, times level 1's")
    it.add_argument("--degree", type=_positive, default=2, metavar="P", help="degree of displacement and geometry")
    for name, what in (("around", "round a hole or core"), ("across", "across each ring"), ("layers", "along the rod")):
        it.add_argument(f"--{name}", type=_positive, metavar="N", help=f"cells {what}, in the place of the mesh's own")
    it.add_argument("--fields", metavar="FILE", help="write nodes, displacements or modes, stress to this .npz file")
    _add_run(it)
    return parser


def _add_biceps(it: argparse.ArgumentParser) -> None:
    it.add_argument("--preset", choices=PRESETS["biceps"], help="start from a configuration; other options change it")
    it.add_argument("--analysis", choices=("statics", "dynamics"), default="statics")
    it.add_argument("--cells", choices=biceps.CELLS, default="tetrahedra")
    it.add_argument("--size", type=float, default=0.3325, metavar="H", help="tetrahedra: length of the edges [cm]")
    it.add_argument("--around", type=int, default=8, metavar="N", help="bricks round a branch, a multiple of 4")
    it.add_argument("--layers", type=int, default=6, metavar="N", help="bricks along each element of the axis")
    it.add_argument("--rings", type=int, default=1, metavar="N", help="bricks: rings round the core")
    it.add_argument("--cuts", type=int, default=1, metavar="N", help="bricks: cuts of the axis elements at held ends")
    it.add_argument("--degree", type=_positive, default=2, metavar="P", help="degree of displacement and geometry")
    it.add_argument("--formulation", choices=FORMULATIONS, default="displacement", help="statics: mixed, Taylor-Hood")
    it.add_argument("--quadrature", type=_positive, metavar="Q", help="degree of the quadrature rule")
    it.add_argument("--parts", type=int, metavar="N", help="contact: rules to a facet's edge; 0: points at the nodes")
    it.add_argument("--time-step", type=float, metavar="DT", help="dynamics: time step [s] (0.9 of the critical one)")
    for field in dataclasses.fields(Biceps):
        if field.name in BICEPS:
            name = f"--{field.name.replace('_', '-')}"
            it.add_argument(name, type=type(field.default), default=field.default, help=field.metadata["help"])
    it.add_argument("--fields", metavar="FILE", help="write nodes, positions and cells to this .npz file")
    _add_run(it)
    # Those that suit the analysis.
    it.set_defaults(flags="")


def _add_common(it: argparse.ArgumentParser, scene: str, cells: Sequence[str]) -> None:
    """Add the options of element and matrix, and those of `_add_run`."""
    it.add_argument("--preset", choices=PRESETS[scene], help="start from a configuration; other options change it")
    it.add_argument("--cells", choices=cells, default="bricks", help="paper: the mesh whose counts the paper gives")
    it.add_argument("--order", type=_positive, metavar="N", help="order of the geometry; the degree if not given")
    it.add_argument("--degree", type=_positive, default=2, metavar="P", help="degree of the displacement")
    it.add_argument("--quadrature", type=_rule, metavar="Q", help="degree of the quadrature rule, or irons14")
    it.add_argument(
        "--family",
        choices=("Lagrange", "S", "enhanced"),
        default="Lagrange",
        help="bricks: S for serendipity, enhanced for 8 nodes with incompatible modes",
    )
    it.add_argument("--matrix", metavar="TYPE", help="PETSc matrix type, such as baij")
    _add_run(it)


def _add_run(it: argparse.ArgumentParser) -> None:
    """Add the options of compiler and timing."""
    it.add_argument("--flags", default=" ".join(FAST), help="C compiler flags, one word: --flags='-O2'")
    it.add_argument("--repeat", type=_positive, default=1, metavar="N", help="runs in this process, the first one cold")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    # Long calls of dolfinx and PETSc let no exception through until they return.
    return ending.run("comparisons.fem", lambda: _main(words), at_once=True)


def _main(arguments: Sequence[str]) -> int:
    ours, petsc = split(arguments)
    parser = _parser()
    given = vars(parser.parse_args(ours))
    preset = given.pop("preset", None)
    if preset:
        # Behind the scene's name and before what was typed, which then wins.
        given = vars(parser.parse_args([ours[0], *PRESETS[ours[0]][preset].split(), *ours[1:]]))
        del given["preset"]
    options.initialize(petsc)
    record = _run(given)
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        print(results.line(record), flush=True)
    return 0


def _run(given: dict[str, Any]) -> dict[str, Any]:
    from isorod.petsc.library import unused_options

    name = given.pop("scene")
    place, _, kind = RUNS[name].rpartition(".")
    scene = import_module(f"comparisons.fem.{place}")
    repeat, file = given.pop("repeat"), given.pop("fields")
    given["flags"] = tuple(given["flags"].split())
    if name == "biceps":
        given["scene"] = Biceps(**{name: given.pop(name) for name in BICEPS})
    with options.petsc_errors():
        record: dict[str, Any] = scene.run(getattr(scene, kind)(**given), repeat, file and Path(file))
    unknown = unused_options()
    if unknown:
        raise InputError(f"PETSc option {', '.join(unknown)}: nothing used it; check its spelling with -help")
    return record


if __name__ == "__main__":
    sys.exit(main())
