"""Files of a mesh, by their ending: requirements of each, checked before anything is meshed."""

import os
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from isorod.errors import InputError
from isorod.model.model import Model
from isorod.output.results import write_whole
from meshes import abaqus, deck, deck_names, gmsh_model, groups, rods, script, vtu
from meshes.mesh import Index, Mesh

# What a file needs besides, by its ending, and how to get it.
_GMSH = "gmsh", "Debian: apt install python3-gmsh; elsewhere: pip install gmsh"
NEEDED = {".msh": _GMSH, ".py": _GMSH, ".inp": None, ".vtu": ("pyvista", "pip install pyvista")}


def check(path: Path, endings: Sequence[str] = tuple(NEEDED)) -> None:
    """Raise `InputError` if a file cannot be written: its ending is none of these, or its folder not to be written to.

    Or if a package is not installed that writes it.
    """
    if path.suffix not in endings:
        raise InputError(f"mesh file: got {str(path)!r}, need a name that ends in {' or '.join(endings)}")
    if not path.parent.is_dir():
        raise InputError(f"mesh file: folder {str(path.parent)!r} does not exist")
    if path.is_dir() or not os.access(path.parent, os.W_OK):
        raise InputError(f"mesh file: cannot write {str(path)!r}")
    needed = NEEDED[path.suffix]
    if needed is not None and find_spec(needed[0]) is None:
        others = ", ".join(name for name, one in NEEDED.items() if one is None)
        raise InputError(
            f"mesh file: {path.suffix} needs {needed[0]}, which is not installed: {needed[1]}; or {others}"
        )


def write(mesh: Mesh, path: Path, scene: Any, element: str | None = None, model: Model | None = None) -> list[str]:
    """Write a mesh of a scene's rods (`meshes.rods.build`), completely or not at all; return notes on it.

    Parameters
    ----------
    path
        ``.msh`` of gmsh (format 4.1): boundaries, rods, and with a model supports, loads, contacts, ties and laws are
        physical groups.  ``.py``: a program of dolfinx (`meshes.script`), with the ``.msh`` beside it.  ``.inp`` of
        Abaqus and CalculiX: the whole problem (`meshes.deck`), of geometry alone node sets and surfaces of the
        boundaries, element sets of rods and of their rings.  ``.vtu``: Lagrange cells, their rod, axis element and ring
        as cell data, the rod's parameters at their nodes.
    element
        Of ``.inp``, one of `meshes.abaqus.ELEMENTS`; where not given what suits the order.
    model
        The scene's, where the complete problem is written, not the mesh alone.

    Raises
    ------
    InputError
        If it cannot be written, or something of the scene has no counterpart in the file.
    """
    check(path)
    names = deck_names.names_of(scene, mesh)
    if path.suffix in (".msh", ".py"):
        notes: list[str] = []
        named = deck_names.renamed(mesh, names)
        if model is not None:
            named = replace(named, faces={**named.faces, **groups.surfaces(scene, model, mesh)})
            laws = {kind.name: kind.cells for kind in groups.kinds(mesh, model, names)}
            named = replace(named, regions={**named.regions, **laws})
        if path.suffix == ".py":
            assert model is not None, "whoever asks for a program has a model"
            text, notes = script.write(scene, model, mesh, path)
            write_whole(path, text.encode())
        gmsh_model.write(named, path.with_suffix(".msh"))
        return notes
    where = dict(zip(("rod", "element", "ring"), rods.places(mesh, scene.rods()).T, strict=True))
    if path.suffix == ".vtu":
        vtu.write(mesh, path, where)
        return []
    element, sets = element or abaqus.BRICKS[mesh.order], _rings(where, names)
    if model is None:
        done = deck.Deck(abaqus.lines(deck_names.renamed(mesh, names), element, sets)[0], [])
    else:
        done = deck.write(scene, model, mesh, element, sets)
    write_whole(path, (done.text + "\n").encode())
    return done.notes


def _rings(where: dict[str, Index], names: deck_names.Names) -> dict[str, Index]:
    """Return the cells of each ring of rods that have several."""
    cells_of_rings = {}
    for rod in np.unique(where["rod"]):
        own = where["rod"] == rod
        rings = np.unique(where["ring"][own])
        for ring in rings if rings.size > 1 else ():
            cells_of_rings[f"{names[f'rod {rod}']} ring {ring}"] = np.flatnonzero(own & (where["ring"] == ring))
    return cells_of_rings
