"""``python -m meshes.study spring --cells tetrahedra -o spring.msh``: write a mesh that a study is made with."""

import argparse
import inspect
import sys
import types
import typing
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from isorod.command import ending
from isorod.command.parser import Parser
from meshes import biceps, blade, files, gmsh_model, spring

SCENES: dict[str, Any] = {"spring": spring, "blade": blade, "biceps": biceps}


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="meshes.study", description="Finite element meshes of the studies, from the Rod's own map.")
    several = parser.add_subparsers(dest="scene", required=True, metavar="SCENE", help=", ".join(SCENES))
    for name, scene in SCENES.items():
        form = argparse.RawDescriptionHelpFormatter
        subparser = several.add_parser(name, help=name, description=inspect.getdoc(scene.build), formatter_class=form)
        _add_options(subparser, scene.build)
        subparser.add_argument("-o", "--output", default=f"{name}.msh", metavar="FILE.msh")
    return parser


def _add_options(parser: argparse.ArgumentParser, build: Callable[..., Any]) -> None:
    """Make each parameter that is a number or a word a ``--long-option``."""
    for name, parameter in inspect.signature(build).parameters.items():
        kind = parameter.annotation
        if isinstance(kind, types.UnionType):
            kind = typing.get_args(kind)[0]
        if kind in (int, float, str):
            shown = "" if parameter.default is None else f"({parameter.default})"
            parser.add_argument(f"--{name}", type=kind, default=parameter.default, metavar=kind.__name__, help=shown)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    # Gmsh lets no exception through until it is done.
    return ending.run("meshes.study", lambda: _main(arguments), at_once=True)


def _main(arguments: Sequence[str] | None) -> int:
    given = vars(_parser().parse_args(sys.argv[1:] if arguments is None else arguments))
    scene, output = SCENES[given.pop("scene")], Path(given.pop("output"))
    files.check(output, (".msh",))
    mesh, bodies = scene.build(**given), scene.rods() if scene is biceps else [scene.rod()]
    gmsh_model.write(mesh, output)
    exact = sum(rod.volume() for rod in bodies)
    print(
        f"{output}: {len(mesh.cells)} cells of {mesh.cells.shape[1]} nodes, {len(mesh.points)} nodes, "
        f"volume {mesh.volume():.6f} ({mesh.volume() / exact - 1.0:+.2e} of the rod's)"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
