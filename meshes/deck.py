"""A scene's whole problem in the words of Abaqus and CalculiX: mesh, materials, supports, loads, steps, output."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from math import ceil
from typing import Any, NamedTuple

import numpy as np

from isorod.errors import InputError
from isorod.model.load import Pressure, SectionLoad
from isorod.model.model import Model
from isorod.model.support import Support
from meshes import abaqus, deck_laws, held, nodal, rods
from meshes.mesh import Array, Index, Mesh

# Nodes that a support turns go straight in a step: a radian is some steps of this angle, degrees.
ANGLE = 10.0

# Modes that are asked for besides: of two of one frequency CalculiX 2.20 misses one if it is the last it is asked for.
_MORE = 4

# A step begins with a quarter of itself: rubber that is twisted by half a turn takes no more at once.
_STATIC = "*STATIC\n0.25,1.,1e-6,1."

# Forces and differences of displacements below this share of the largest are rounding.
_ROUNDING = 1e-12

_LATER = "--mesh-only writes the mesh alone"

Names = dict[str, str]


class Deck(NamedTuple):
    """An input file's text, and what there is to say of it, a line each."""

    text: str
    said: list[str]


def names_of(scene: Any, mesh: Mesh) -> Names:
    """Return the names that parts of a mesh of rods have in files: ``rod 0`` is ``rod wire``; `InputError` if twice."""
    known = scene.rod_names()
    found = {f"rod {k}": f"rod {name}" for k, name in enumerate(known)} or {name: name for name in mesh.regions}
    _once(found.values())
    return found


def _once(names: Iterable[str]) -> None:
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


def write(scene: Any, mesh: Mesh, element: str, sets: dict[str, Index]) -> Deck:
    """Return the input file of a scene of statics or modes on a mesh of its rods.

    Parameters
    ----------
    scene
        The scene.
    mesh
        Of `meshes.rods.build`.
    element
        One of `meshes.abaqus.ELEMENTS`.
    sets
        More sets of elements, by name.

    Raises
    ------
    InputError
        If something of it has no counterpart in such files.
    """
    if scene.analysis not in ("statics", "modal"):
        raise InputError(f"{scene.name}: {scene.analysis} is not written to .inp, statics and modes are; {_LATER}")
    with scene.locating():
        model, settings = scene.model(), scene.settings()
    try:
        return _Problem(scene, model, settings, mesh, element, sets).deck()
    except InputError as problem:
        said = ":".join(scene.named(part) for part in str(problem).split(":"))
        raise InputError(f"{scene.name}: {said}; {_LATER}") from None


class _Problem:
    def __init__(
        self, scene: Any, model: Model, settings: dict[str, Any], mesh: Mesh, element: str, sets: dict[str, Index]
    ) -> None:
        self.scene, self.model, self.mesh = scene, model, mesh
        for kind, several in (("solid", model.solids), ("tie", model.ties), ("contact", model.contacts)):
            if several:
                raise InputError(f"{kind} 0 and its like are not written to .inp")
        for k, support in enumerate(model.supports):
            if not isinstance(support, Support):
                raise InputError(f"support {k}: mean motions and springs are not written to .inp")
        self.modes = settings.get("modes", 10) if scene.analysis == "modal" else 0
        self.linear = all(law.linear for body in model.bodies for law in body.laws)
        if not self.linear and any(law.linear for body in model.bodies for law in body.laws):
            raise InputError("laws of small and of large displacements in one scene are not written to .inp")
        self.moves = not settings.get("at_rest", False) if self.modes else True
        if self.modes:
            self._check_modes()
        self.large = not self.linear and self.moves
        if self.linear and model.following:
            raise InputError("a pressure that follows, and a law of small displacements, are not written to .inp")
        self.names = names_of(scene, mesh)
        self.element, self.sets = element, sets
        self.said: list[str] = []
        self.held = held.all_of(mesh, model)
        self.dead: Array = nodal.dead(mesh, model)
        # Of several supports on a node the last one holds it, as in isorod.
        self.owner = np.full((len(mesh.points), 3), -1)
        for k, one in enumerate(self.held):
            self.owner[one.nodes[:, None], one.components] = k

    def _check_modes(self) -> None:
        """Refuse modes that turn or have no mass; those of laws whose stiffness no load changes are at rest."""
        from isorod.modal.loaded import burdens, spins

        if spins(self.model) and self.moves:
            raise InputError("modes of a spin, with Coriolis forces, are not written to .inp; at_rest = true are")
        for b, body in enumerate(self.model.bodies):
            if not body.densities.min() > 0.0:
                raise InputError(f"modes: body {b} has no density")
        self.moves = self.moves and not self.linear and bool(burdens(self.model))

    def deck(self) -> Deck:
        """Return the file."""
        supports = {k: self.scene.named(f"support {k}") for k in range(len(self.held))}
        loads = {k: self.scene.named(f"load {k}") for k in range(len(self.model.loads))}
        _once([*supports.values(), *loads.values()])
        self.supports, self.loads = ({k: abaqus.name_of(name) for k, name in one.items()} for one in (supports, loads))
        materials = [*self._materials()]
        text, self.number = abaqus.lines(renamed(self.mesh, self.names), self.element, self.sets)
        own = list(self._sets())
        steps = list(self._steps())
        notes = [f"** {one}" for one in self.said]
        head = ["*HEADING", self.scene.title.encode("ascii", "replace").decode().lstrip("*"), *notes]
        return Deck("\n".join([*head, text, *own, *materials, *steps]), self.said)

    def _materials(self) -> Iterator[str]:
        """Yield materials and sections, and put their sets of elements to the others."""
        where = rods.places(self.mesh, [body.space.rod for body in self.model.bodies])
        for b, body in enumerate(self.model.bodies):
            rod = self.names[f"rod {b}"]
            cells = self.mesh.regions[f"rod {b}"]
            rings = len(body.space.rod.rings) - 1
            numbers: dict[tuple[int, float], int] = {}
            given = zip(map(id, body.laws), body.densities.tolist(), strict=True)
            kinds = np.array([numbers.setdefault(one, len(numbers)) for one in given]).reshape(-1, rings)
            own = np.empty((body.space.rod.axis.elements, rings), dtype=np.int64)
            own[body.space.own_elements] = kinds
            if (own[body.space.own_elements] != kinds).any():
                raise InputError(f"body {b}: laws that change within the elements of its axis are not written to .inp")
            present = np.unique(own).tolist()
            of_cells = own[where[cells, 1], where[cells, 2]]
            for count, kind in enumerate(present):
                name = rod if len(present) == 1 else f"{rod} law {count}"
                if len(present) > 1:
                    self.sets[name] = cells[of_cells == kind]
                at = int(np.argmax(kinds.ravel() == kind))
                law = body.laws[at]
                words, said = deck_laws.finite(law) if self.large else deck_laws.elastic(law)
                if said:
                    self.said.append(f"{name}: {said}")
                title = abaqus.name_of(name)
                yield from [f"*MATERIAL,NAME={title}", *words]
                if body.densities[at] > 0.0:
                    yield from ["*DENSITY", f"{body.densities[at]:.12g}"]
                yield f"*SOLID SECTION,ELSET={title},MATERIAL={title}"

    def _sets(self) -> Iterator[str]:
        """Yield the nodes of supports and of forces on ends, and what supports tie."""
        for k, one in enumerate(self.held):
            yield from abaqus.set_of_nodes(self.supports[k], np.sort(self.number[one.nodes]))
            on = np.where(self.owner == k, self.dead, 0.0).sum(axis=0)
            if not self.modes and np.abs(on).max() > _ROUNDING * np.abs(self.dead).max():
                told = ", ".join(f"{value:.6g}" for value in on)
                self.said.append(f"{self.supports[k]}: loads on its own nodes, ({told}), are in the RF of CalculiX")
        for k, load in enumerate(self.model.loads):
            if isinstance(load, SectionLoad):
                face = self.mesh.faces[nodal.end_of(k, load, self.model)]
                yield from abaqus.set_of_nodes(self.loads[k], np.unique(self.number[face]))
        for k, one in enumerate(self.held):
            if one.tied and one.motion.turn.any():
                raise InputError(f"support {k}: a face that turns and is tied is not written to .inp")
            first, *others = self.number[one.nodes][self.number[one.nodes] > 0].tolist()
            for component in one.tied:
                for node in others:
                    yield from ["*EQUATION", "2", f"{node},{component + 1},1.,{first},{component + 1},-1."]

    def _steps(self) -> Iterator[str]:
        """Yield the steps: statics in as many as turns and supports that move for a time take, then modes."""
        if not self.modes or self.moves:
            for factor in self._stops():
                yield from ["*STEP,NLGEOM,INC=10000", _STATIC] if self.large else ["*STEP", "*STATIC"]
                yield from self._boundary(factor)
                yield from self._loaded(factor)
                yield from self._printed()
        if self.modes:
            from isorod.checks.rigid_motions import moved_freely

            rigid = len(moved_freely(self.model))
            yield from ["*STEP,PERTURBATION" if self.moves else "*STEP", "*FREQUENCY", f"{self.modes + rigid + _MORE}"]
            if rigid:
                self.said.append(f"the first {rigid} modes are rigid motions")
            if not self.moves:
                yield from self._boundary(0.0)
            yield from ["*NODE FILE", "U", "*END STEP"]

    def _stops(self) -> list[float]:
        """Return the load factors at which steps end."""
        if not self.large:
            return [1.0]
        found = {*self.model.stages}
        for one in self.model.motions:
            parts = max(ceil(np.degrees(np.linalg.norm(one.turn)) / ANGLE - 1e-6), len(one.path) - 1)
            begin, end = one.during
            found |= {begin + (end - begin) * k / parts for k in range(1, parts + 1)}
        return sorted(found - {0.0})

    def _boundary(self, factor: float) -> Iterator[str]:
        """Yield what supports prescribe: of all their nodes at once where they move alike, else of each node."""
        if self.held:
            yield "*BOUNDARY"
        for k, one in enumerate(self.held):
            moved = one.displacement(factor)
            for component in one.components:
                mine = self.owner[one.nodes, component] == k
                numbers, values = self.number[one.nodes], moved[:, component]
                dof = f"{component + 1},{component + 1}"
                if mine.all() and np.ptp(values) <= _ROUNDING * np.abs(moved).max():
                    yield f"{self.supports[k]},{dof},{values[0]:.12g}"
                    continue
                for node, value in zip(numbers[mine].tolist(), values[mine].tolist(), strict=True):
                    if node:
                        yield f"{node},{dof},{value:.12g}"

    def _loaded(self, factor: float) -> Iterator[str]:
        """Yield dead loads as forces on nodes, pressures that follow and the spin as such."""
        forces = factor * self.dead
        rows, components = np.nonzero(np.abs(forces) > _ROUNDING * np.abs(forces).max(initial=0.0))
        if rows.size:
            yield "*CLOAD"
        for row, component in zip(rows.tolist(), components.tolist(), strict=True):
            yield f"{self.number[row]},{component + 1},{forces[row, component]:.12g}"
        for load in (one for one in self.model.following if isinstance(one, Pressure)):
            rod, k, surface = nodal.face_of(load).split(" ")
            title = abaqus.name_of(f"{self.names[f'{rod} {k}']} {surface}")
            yield from ["*DSLOAD", f"{title},P,{factor * load.pressure:.12g}"]
        spin = self.model.spin
        if spin is not None and any(spin.velocity):
            speed = float(np.linalg.norm(spin.velocity))
            axis = ",".join(f"{one:.12g}" for one in [*spin.center, *(np.array(spin.velocity) / speed)])
            yield from ["*DLOAD", f"{abaqus.ALL_ELEMENTS},CENTRIF,{factor * speed**2:.12g},{axis}"]

    def _printed(self) -> Iterator[str]:
        """Yield what is asked for: the forces of each support and their sum, the displacements where forces pull."""
        for k in range(len(self.held)):
            yield from [f"*NODE PRINT,NSET={self.supports[k]},TOTALS=YES,FREQUENCY=10000", "RF"]
        for k, load in enumerate(self.model.loads):
            if isinstance(load, SectionLoad):
                yield from [f"*NODE PRINT,NSET={self.loads[k]},FREQUENCY=10000", "U"]
        yield from ["*NODE FILE,FREQUENCY=10000", "U,RF", "*EL FILE,FREQUENCY=10000", "S,E", "*END STEP"]
