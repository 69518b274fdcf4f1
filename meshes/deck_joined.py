"""Ties and contacts of a scene in an input file, and the surfaces and obstacles that these take."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from isorod.checks.embedded import parts
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.model.tie import EndFace, LateralSurface, SolidSurface, Surface, Tie
from meshes import abaqus, deck_embedded, deck_pairs, deck_solids
from meshes.mesh import Array, Index, Mesh

# Surfaces that are tied are one where their areas, of corners, differ by less.
_SAME_AREA = 0.05

# An end that is farther within another rod, in radii, would be torn out of it by a tie that moves nodes.
_DEEP = 0.5


class _Size(NamedTuple):
    """The area of a surface, that of each of its faces, and how far it extends."""

    area: float
    each: float
    extent: float


class Pairs:
    """Pairs of surfaces of a scene.

    Attributes
    ----------
    meshes
        Of all rods, of each finite element body, and of obstacles, with faces of all surfaces that are named.
    obstacles
        Their names, and the numbers of their contacts.
    printed, notes
        Lines that ask for what ties and contacts carry, and notes, lines too.
    """

    def __init__(self, scene: Any, model: Model, mesh: Mesh, meshes: list[Mesh], names: dict[str, str]) -> None:
        self.scene, self.model, self.mesh, self.meshes, self.names = scene, model, mesh, meshes, names
        self.obstacles: list[tuple[str, int]] = []
        self.printed: list[str] = []
        self.notes: list[str] = []
        self._embedded: list[tuple[int, Index, Index, Array]] = []

    def ties(self) -> Iterator[str]:
        """Yield ties, and put what is a part of a face to the faces of its mesh."""
        deep = [
            one.tie for one in parts(self.model) if one.depth > _DEEP * self.model.bodies[one.body].space.rod.radius
        ]
        moving = False
        for k, tie in enumerate(self.model.ties):
            title = self.scene.named(f"tie {k}")
            if k in deep:
                self._embed(k, tie)
                continue
            if not moving:
                moving = True
                self.notes.append("ties: CalculiX moves the nodes of the slave onto the master")
                yield "** Ties: the slave's nodes follow the master"
            (slave, mine), (master, other) = (
                self._surface(one, f"{title} {side}") for one, side in ((tie.slave, "slave"), (tie.master, "master"))
            )
            if other.each < mine.each:
                # CalculiX ties nodes: those of the coarser side would leave others loose.
                if abs(other.area - mine.area) < _SAME_AREA * mine.area:
                    slave, master = master, slave
                    self.notes.append(f"{title}: the master is CalculiX' slave, whose mesh is the finer one")
                else:
                    self.notes.append(f"{title}: the master's mesh is finer than the slave's; take a higher --level")
            yield from deck_pairs.tied(tie, abaqus.name_of(title), slave, master, mine.extent)
            self.printed += [f"*SECTION PRINT,SURFACE={slave},NAME={abaqus.name_of(title)}", "SOF,SOM"]

    def _embed(self, k: int, tie: Tie) -> None:
        """Let the nodes of an end move as the cells of the rod do that they are in: `*TIE` would pull them out."""
        if not isinstance(tie.slave, EndFace) or tie.kind != "weld":
            raise InputError(f"tie {k}: deep within a rod the weld of an end as the slave is written to .inp alone")
        assert isinstance(tie.master, LateralSurface), "the end of a rod is within no other surface"
        nodes = np.unique(deck_pairs.surface_of(self.model, self.mesh, tie.slave)[1])
        try:
            interpolation = deck_embedded.interpolation(
                self.mesh, self.mesh.regions[f"rod {tie.master.body}"], self.mesh.points[nodes]
            )
        except InputError as problem:
            raise InputError(f"tie {k}: {problem}") from None
        self._embedded.append((k, nodes, *interpolation))
        title = self.scene.named(f"tie {k}")
        self.notes.append(f"{title}: nodes of the end move as the other rod does where they are, by *EQUATION")

    def equations(self, number: Index, taken: NDArray[np.bool_]) -> Iterator[str]:
        """Yield the equations of ends within other rods, by the numbers of nodes, of which some are held otherwise."""
        for k, nodes, masters, weights in self._embedded:
            if taken[nodes].any():
                raise InputError(f"tie {k}: an end that a support holds, too, is not written to .inp")
            yield from deck_embedded.equations(number, nodes, masters, weights)

    def turning(self, last: int) -> Iterator[str]:
        """Yield the nodes with which obstacles turn, behind so many nodes."""
        for name, k in self.obstacles:
            motion = self.model.contacts[k].motion
            if motion is not None and motion.track[:, 4].any():
                yield from deck_pairs.turning(motion, abaqus.name_of(name), last)
                last += 2

    def _surface(self, tied: Surface, name: str) -> tuple[str, _Size]:
        """Return the title of a surface in the file, which is made where it has none, and its size."""
        if isinstance(tied, SolidSurface):
            at, face = 1 + tied.solid, ""
            faces = deck_solids.facets_of(self.model.solids[tied.solid], tied.facets)
        else:
            at = 0
            face, faces = deck_pairs.surface_of(self.model, self.mesh, tied)
        mesh = self.meshes[at]
        if not face:
            face = name
            self.meshes[at] = replace(mesh, faces={**mesh.faces, name: faces})
        else:
            rod, k, surface = face.split(" ")
            face = f"{self.names[f'{rod} {k}']} {surface}"
        area = deck_pairs.area(mesh, faces)
        extent = float(np.ptp(mesh.points[faces].reshape(-1, 3), axis=0).max())
        return abaqus.name_of(face), _Size(area, area / len(faces), extent)

    def contacts(self) -> Iterator[str]:
        """Yield contacts, and put obstacles to the meshes."""
        for k, contact in enumerate(self.model.contacts):
            title = self.scene.named(f"contact {k}")
            pairs, alone = deck_pairs.pairs(contact)
            if alone and not pairs:
                raise InputError(f"contact {k}: contact of a rod with itself is nothing that CalculiX has")
            if alone:
                self.notes.append(f"{title}: rods do not touch themselves, which CalculiX has not")
            yield from deck_pairs.interaction(contact, self.model, abaqus.name_of(title))
            other = ""
            if contact.facets is not None:
                other = self._surface(contact.facets, f"{title} master")[0]
            elif contact.obstacle is not None:
                points = self.mesh.points[
                    np.unique(self.mesh.cells[[c for a, _ in pairs for c in self.mesh.regions[f"rod {a}"]]])
                ]
                name = f"{title} obstacle"
                self.meshes.append(deck_pairs.obstacle(contact, points, name))
                self.obstacles.append((name, k))
                other = abaqus.name_of(name)
            for first, second in pairs:
                slave = self._touching(k, first, 0)
                master = other or self._touching(k, second, 1)
                yield f"*CONTACT PAIR,INTERACTION={abaqus.name_of(title)},TYPE=SURFACE TO SURFACE"
                yield f"{slave},{master}"
                self.printed += [f"*CONTACT PRINT,SLAVE={slave},MASTER={master},FREQUENCY=10000", "CF"]

    def _touching(self, k: int, rod: int, side: int) -> str:
        """Return the title of a rod's surface that takes part in a contact."""
        contact = self.model.contacts[k]
        surface = "inner" if contact.is_inner(rod) else "lateral"
        chosen = (contact.first_elements, contact.second_elements)[side]
        if chosen is None:
            return abaqus.name_of(f"{self.names[f'rod {rod}']} {surface}")
        breaks = self.model.bodies[rod].space.axis.breaks
        some = [
            deck_pairs.within(self.mesh, rod, f"rod {rod} {surface}", breaks[e], breaks[e + 1], breaks[-1])
            for e in chosen
        ]
        name = f"{self.scene.named(f'contact {k}')} {('first', 'second')[side]}"
        self.meshes[0] = replace(self.meshes[0], faces={**self.meshes[0].faces, name: np.concatenate(some)})
        return abaqus.name_of(name)
