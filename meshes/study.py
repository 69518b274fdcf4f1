"""``python -m meshes.study spring --cells tetrahedra -o spring.msh``: write a mesh that a study is made with."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from isorod.command import ending
from isorod.errors import InputError
from meshes import biceps, blade, files, gmsh_model, spring

SCENES: dict[str, Any] = {"spring": spring, "blade": blade, "biceps": biceps}


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise InputError(message)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="meshes.study", description="Finite element meshes of the studies, from the Rod's own map.")
    several = parser.add_subparsers(dest="scene", required=True, metavar="SCENE", help=", ".join(SCENES))
    it = several.add_parser("spring", help="the helical spring")
    it.add_argument("--cells", choices=spring.CELLS, default="bricks")
    it.add_argument("--around", type=int, default=8, metavar="N", help="cells round the wire (bricks: multiple of 4)")
    it.add_argument("--layers", type=int, default=48, metavar="N", help="cells along the wire (multiple of 12)")
    it.add_argument("--order", type=int, default=2, metavar="N", help="order of the geometry")
    it.add_argument("--rings", type=int, default=1, metavar="N", help="bricks: rings round the core")
    it.add_argument("--core", type=float, metavar="R", help="bricks: radius of the core's corners, between 0 and 1")
    it.add_argument("-o", "--output", default="spring.msh", metavar="FILE.msh")
    it = several.add_parser("blade", help="the wind turbine blade")
    it.add_argument("--cells", choices=blade.CELLS, default="bricks")
    it.add_argument("--along", type=int, default=6, metavar="N", help="cells along the chord")
    it.add_argument("--across", type=int, default=1, metavar="N", help="cells across the thickness")
    it.add_argument("--layers", type=int, default=12, metavar="N", help="cells from root to tip")
    it.add_argument("--order", type=int, default=2, metavar="N", help="order of the geometry")
    it.add_argument(
        "--grading", type=float, default=1.0, metavar="G", help="layer k of N starts at (k / N)^G of the way"
    )
    it.add_argument("--clustering", type=float, default=1.0, metavar="C", help="0: cells equally long along the chord")
    it.add_argument("-o", "--output", default="blade.msh", metavar="FILE.msh")
    it = several.add_parser("biceps", help="both branches of the biceps")
    it.add_argument("--cells", choices=biceps.CELLS, default="tetrahedra")
    it.add_argument("--size", type=float, default=0.3325, metavar="H", help="tetrahedra: length of the edges [cm]")
    it.add_argument("--around", type=int, default=8, metavar="N", help="bricks round a branch (multiple of 4)")
    it.add_argument("--layers", type=int, default=6, metavar="N", help="bricks along each element of the axis")
    it.add_argument("--order", type=int, default=1, metavar="N", help="order of the geometry")
    it.add_argument("--rings", type=int, default=1, metavar="N", help="bricks: rings round the core")
    it.add_argument("--cuts", type=int, default=1, metavar="N", help="bricks: cuts of the axis elements at held ends")
    it.add_argument("-o", "--output", default="biceps.msh", metavar="FILE.msh")
    return parser


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
