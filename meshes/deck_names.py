"""Names of a scene's parts as names of sets in an input file, no two the same."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from isorod.errors import InputError
from meshes import abaqus
from meshes.mesh import Mesh

Names = dict[str, str]


def names_of(scene: Any, mesh: Mesh) -> Names:
    """Return the names that parts of a mesh of rods have in files: ``rod 0`` is ``rod wire``; `InputError` if twice."""
    known = scene.rod_names()
    names = {f"rod {k}": f"rod {name}" for k, name in enumerate(known)} or {name: name for name in mesh.regions}
    once(names.values())
    return names


def once(names: Iterable[str]) -> None:
    """Raise `InputError` if two names are one in an input file."""
    seen: dict[str, str] = {}
    for name in names:
        other = seen.setdefault(abaqus.name_of(name), name)
        if other != name:
            raise InputError(f"{other} and {name}: both are {abaqus.name_of(name)} in an input file; rename one")


def renamed(mesh: Mesh, names: Names) -> Mesh:
    """Return a mesh whose regions and faces have the names of `names_of`."""

    def name(one: str) -> str:
        rod, k, *rest = one.split(" ")
        return " ".join([names[f"{rod} {k}"], *rest])

    return replace(
        mesh,
        regions={name(key): cells for key, cells in mesh.regions.items()},
        faces={name(key): face for key, face in mesh.faces.items()},
    )
