"""``python -m meshes spring --cells bricks -o spring.msh``: write a mesh of a scene's geometry, or of a file's rods."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from isorod import files, scenes
from isorod.command import ending
from isorod.errors import InputError
from isorod.geometry.rod import Rod
from meshes import biceps, blade, gmsh_model, rods, spring

# Scenes with meshes of their own.
SCENES = {"spring": spring, "blade": blade, "biceps": biceps}


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise InputError(message)


def _parser(name: str) -> argparse.ArgumentParser:
    parser = _Parser(prog="meshes", description="Finite element meshes of the scenes, from the Rod's own map.")
    known = ", ".join(scenes.SCENES)
    several = parser.add_subparsers(dest="scene", required=True, metavar="SCENE", help=f"{known}, or a file my.toml")
    for one in (*(scene for scene in scenes.SCENES if scene not in SCENES), *([name] if _is_file(name) else [])):
        it = several.add_parser(one, help="its rods")
        it.add_argument("--level", type=int, default=1, metavar="L", help="L times as many cells in all directions")
        it.add_argument("--order", type=int, default=2, metavar="N", help="order of the geometry, 1 to 3")
        it.add_argument("-o", "--output", default=f"{Path(one).stem}.msh", metavar="FILE.msh")
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
    return ending.run("meshes", lambda: _main(arguments), at_once=True)


def _is_file(name: str) -> bool:
    return name.endswith(".toml")


def _rods(name: str) -> Sequence[Rod]:
    """Return the rods of a file or of a scene as it is without options."""
    scene = files.find(name) if _is_file(name) else files.find(name)()
    return scene.rods() if hasattr(scene, "rods") else [scene.rod()]


def _main(arguments: Sequence[str] | None) -> int:
    words = sys.argv[1:] if arguments is None else arguments
    given = vars(_parser(next(iter(words), "")).parse_args(words))
    name, output = given.pop("scene"), given.pop("output")
    if name in SCENES:
        scene = SCENES[name]
        mesh, bodies = scene.build(**given), scene.rods() if scene is biceps else [scene.rod()]
    else:
        bodies = _rods(name)
        mesh = rods.build(bodies, **given)
    gmsh_model.write(mesh, output)
    exact = sum(rod.volume() for rod in bodies)
    print(
        f"{output}: {len(mesh.cells)} cells of {mesh.cells.shape[1]} nodes, {len(mesh.points)} nodes, "
        f"volume {mesh.volume():.6f} ({mesh.volume() / exact - 1.0:+.2e} of the rod's)"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
