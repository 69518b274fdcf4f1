"""``isorod mesh spring spring.inp``: write hexahedra of a scene's rods, or of a file's; also ``python -m meshes``."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from isorod.command import chosen, ending
from isorod.command.parser import Parser
from isorod.errors import InputError
from isorod.geometry.rod import Rod
from isorod.model.model import Model
from meshes import abaqus, cuts, deck, files, rods, script
from meshes.mesh import Mesh


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    # Gmsh lets no exception through until it is done.
    return ending.run("isorod", lambda: _main(sys.argv[1:] if arguments is None else arguments), at_once=True)


def _main(words: Sequence[str]) -> int:
    if chosen.usage("mesh", words, ()):
        return 0
    scene, given, _ = chosen.choose("mesh", words, (), _more)
    paths = [Path(name) for name in given.files or [f"{scene.name}.msh"]]
    for path in paths:
        files.check(path)
    order = _order(given.cell_order, given.element, paths)
    model = _model(scene, paths, given.mesh_only)
    bodies = [cuts.cut(model, b) for b in range(len(model.bodies))] if model else scene.rods()
    exact = sum(rod.volume() for rod in bodies)
    mesh = _fine(bodies, order, exact) if given.level is None else rods.build(bodies, given.level, order)
    for path in paths:
        notes = files.write(mesh, path, scene, given.element, model)
        print(
            f"{path}: {len(mesh.cells):,} hexahedra of order {order}, {len(mesh.points):,} nodes, volume "
            f"{mesh.volume():.6g} ({mesh.volume() / exact - 1.0:+.1e} of the rods')"
        )
        for one in notes:
            print(f"  {one}")
    return 0


def _model(scene: Any, paths: Sequence[Path], mesh_only: bool) -> Model | None:
    """Return the model, if a file wants more than the mesh; raise `InputError` if that is not written."""
    endings = {path.suffix for path in paths}
    if ".py" in endings and (mesh_only or scene.analysis == "geometry"):
        raise InputError(f"{scene.name}: a program of dolfinx is of statics, not of a mesh alone; write .msh")
    if mesh_only or scene.analysis == "geometry" or not endings & {".inp", ".msh", ".py"}:
        return None
    if ".inp" in endings:
        deck.check(scene)
    with scene.locating():
        model = scene.model()
    if ".py" in endings:
        script.check(scene, model)
    return model


# The level that is tried first where none is given, and how near the volume of the cells is then to that of the rods,
# relative; of cells of order 1, which have no curved edges, the first is taken.
LEVEL, VOLUME = 2, 1e-3

_EPILOG = (
    "Curved hexahedra of any rods, by the rods' own map. "
    "FILE ends in .msh (gmsh), .inp (Abaqus, CalculiX), .py (dolfinx, with the .msh) or .vtu (VTK)."
)


def _more(parser: Parser, scene: Any) -> None:
    parser.epilog = _EPILOG
    parser.add_argument("files", nargs="*", metavar="FILE", help="file to write (SCENE.msh)")
    parser.add_argument(
        "--level",
        type=int,
        metavar="int",
        help=f"factor of the cells in each direction ({LEVEL}, or what a volume within {100.0 * VOLUME:g} %% takes)",
    )
    parser.add_argument(
        "--mesh-only", action="store_true", help="no materials, supports, loads and steps in .inp: the mesh alone"
    )
    parser.add_argument("--cell-order", type=int, metavar="int", help="order of the cells' geometry, 1 to 3 (2)")
    bricks = [name for name in abaqus.ELEMENTS if not name.startswith(("C3D10", "C3D4"))]
    parser.add_argument(
        "--element", choices=bricks, help="element of .inp, which chooses the order too (C3D20R, of order 1 C3D8I)"
    )


def _fine(bodies: Sequence[Rod], order: int, exact: float) -> Mesh:
    """Return the mesh of the first level whose volume is near enough."""
    for level in range(LEVEL, rods.MOST + 1):
        mesh = rods.build(bodies, level, order)
        if order == 1 or abs(mesh.volume() - exact) < VOLUME * exact:
            break
    return mesh


def _order(given: int | None, element: str | None, paths: Sequence[Path]) -> int:
    """Return the order of the cells that options and files want; raise `InputError` if these differ."""
    order = (abaqus.ELEMENTS[element].order if element else 2) if given is None else given
    deck = next((path for path in paths if path.suffix == ".inp"), None)
    if deck and element and order != abaqus.ELEMENTS[element].order:
        raise InputError(f"element {element}: its cells have order {abaqus.ELEMENTS[element].order}, got {order}")
    if deck and order > max(abaqus.BRICKS):
        raise InputError(f"mesh file {deck}: got cells of order {order}, need 1 or 2; .msh and .vtu take others")
    return order


if __name__ == "__main__":
    sys.exit(main())
