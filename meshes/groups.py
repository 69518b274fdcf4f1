"""Parts of a mesh of rods by what a scene does with them: cells of one law, surfaces of supports, loads and pairs."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from isorod.errors import InputError
from isorod.material.law import Material
from isorod.model.load import Pressure, SectionLoad
from isorod.model.model import Model
from isorod.model.support import Support
from isorod.model.tie import SolidSurface
from meshes import deck_pairs, held, nodal, rods
from meshes.mesh import Index, Mesh


class Kind(NamedTuple):
    """Cells of one law: their name, their numbers, the law and the density; and whether they are all of a rod."""

    name: str
    cells: Index
    law: Material
    density: float
    whole: bool


def kinds(mesh: Mesh, model: Model, names: Mapping[str, str]) -> Iterator[Kind]:
    """Yield the cells of each law of each rod: ``rod wire``, or ``rod wire law 0`` ... where it has several."""
    where = rods.places(mesh, [body.space.rod for body in model.bodies])
    for b, body in enumerate(model.bodies):
        rod = names[f"rod {b}"]
        cells = mesh.regions[f"rod {b}"]
        rings = len(body.space.rod.rings) - 1
        numbers: dict[tuple[int, float], int] = {}
        given = zip(map(id, body.laws), body.densities.tolist(), strict=True)
        numbers_of_laws = np.array([numbers.setdefault(one, len(numbers)) for one in given]).reshape(-1, rings)
        own = np.empty((body.space.rod.axis.elements, rings), dtype=np.int64)
        own[body.space.own_elements] = numbers_of_laws
        if (own[body.space.own_elements] != numbers_of_laws).any():
            raise InputError(f"body {b}: laws that change within the elements of its axis are not written")
        present = np.unique(own).tolist()
        of_cells = own[where[cells, 1], where[cells, 2]]
        for count, kind in enumerate(present):
            at, whole = int(np.argmax(numbers_of_laws.ravel() == kind)), len(present) == 1
            name = rod if whole else f"{rod} law {count}"
            yield Kind(name, cells[of_cells == kind], body.laws[at], float(body.densities[at]), whole)


def surfaces(scene: Any, model: Model, mesh: Mesh) -> dict[str, Index]:
    """Return the faces of supports, loads, contacts and ties on rods, by their names in the scene.

    Mean supports and what acts on lines and at places have none; of a contact and a tie of two rods there are two.
    """
    surfaces: dict[str, Index] = {}
    for k, support in enumerate(model.supports):
        if isinstance(support, Support):
            face_nodes = held.Held(k, model, held.surface(mesh, support.body, model.bodies[support.body].space))
            sides = [face for name, face in mesh.faces.items() if name.startswith(f"rod {support.body} ")]
            sides = [face[np.isin(face, face_nodes.nodes).all(axis=1)] for face in sides]
            surfaces[scene.named(f"support {k}")] = np.concatenate(sides)
    for k, load in enumerate(model.loads):
        if isinstance(load, SectionLoad):
            surfaces[scene.named(f"load {k}")] = nodal.face_at(mesh, load.body, load.u, model)
        elif isinstance(load, Pressure):
            surfaces[scene.named(f"load {k}")] = mesh.faces[nodal.face_of(load)]
    for k, contact in enumerate(model.contacts):
        two = ("first", "second") if len(contact.groups) > 1 else ("",)
        for bodies, which in zip(contact.groups, two, strict=True):
            surface = ["inner" if contact.is_inner(b) else "lateral" for b in bodies]
            own = [mesh.faces[f"rod {b} {what}"] for b, what in zip(bodies, surface, strict=True)]
            surfaces[f"{scene.named(f'contact {k}')} {which}".strip()] = np.concatenate(own)
    for k, tie in enumerate(model.ties):
        for what, which in ((tie.slave, "slave"), (tie.master, "master")):
            if not isinstance(what, SolidSurface):
                surfaces[f"{scene.named(f'tie {k}')} {which}"] = deck_pairs.surface_of(model, mesh, what)[1]
    return {name: faces for name, faces in surfaces.items() if len(faces)}
