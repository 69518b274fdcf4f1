"""A scene's whole problem in the words of Abaqus and CalculiX: mesh, materials, supports, loads, steps, output."""

from collections.abc import Iterator
from math import ceil
from typing import Any, NamedTuple

import numpy as np

from isorod.errors import InputError
from isorod.material.thermal import Thermal, bare
from isorod.model.load import SectionLoad
from isorod.model.model import Model, unmoved
from isorod.model.times import until
from meshes import (
    abaqus,
    deck_harmonic,
    deck_heat,
    deck_joined,
    deck_laws,
    deck_loads,
    deck_means,
    deck_names,
    deck_pairs,
    deck_solids,
    groups,
    held,
    nodal,
)
from meshes.mesh import Array, Index, Mesh

# Nodes that a support turns go straight in a step: a radian is some steps of this angle, degrees.
ANGLE = 10.0

# Modes that are asked for besides: of two of one frequency CalculiX 2.20 misses one if it is the last it is asked for.
_MORE = 4

# A step begins with a quarter of itself: rubber that is twisted by half a turn takes no more at once.
_STATIC = "*STATIC\n0.25,1.,1e-6,1."

# Forces and differences of displacements below this fraction of the largest are rounding.
_ROUNDING = 1e-12

# Of load factors; CalculiX' own is a hundredth.
_ACCURACY = "1e-6"

_LATER = "--mesh-only writes the mesh alone"


class Deck(NamedTuple):
    """An input file's text, and notes on it, a line each."""

    text: str
    notes: list[str]


def write(scene: Any, model: Model, mesh: Mesh, element: str, sets: dict[str, Index]) -> Deck:
    """Return the input file of a scene of statics, modes, buckling or harmonic response on a mesh of its rods.

    Parameters
    ----------
    scene, model
        The scene, and its model.
    mesh
        Of `meshes.rods.build`, with the planes of `meshes.cuts`.
    element
        One of `meshes.abaqus.ELEMENTS`.
    sets
        More sets of elements, by name.

    Raises
    ------
    InputError
        If something of it has no counterpart in such files.
    """
    try:
        settings = scene.settings()
        end_time = settings.get("end_time")
        unmoved(model, scene.analysis, timed=end_time is not None or settings.get("at_rest", False))
        model = model if end_time is None else until(model, end_time)
        return _Problem(scene, model, settings, mesh, element, sets).deck()
    except InputError as problem:
        message = ":".join(scene.named(part) for part in str(problem).split(":"))
        raise InputError(f"{scene.name}: {message}; {_LATER}") from None


def check(scene: Any) -> None:
    """Raise `InputError` if an analysis is not one that is written."""
    if scene.analysis not in ("statics", "modal", "buckling", "harmonic"):
        raise InputError(
            f"{scene.name}: {scene.analysis} is not written to .inp, statics, modes, buckling, harmonic are; {_LATER}"
        )


class _Block(NamedTuple):
    """A part of the file: its mesh, its element, the numbers of its nodes, and forces on these at load factor 1."""

    mesh: Mesh
    element: str
    number: Index
    dead: Array


class _Problem:
    def __init__(
        self, scene: Any, model: Model, settings: dict[str, Any], mesh: Mesh, element: str, sets: dict[str, Index]
    ) -> None:
        self.kind, self.notes = scene.analysis, list[str]()
        self.swing = deck_harmonic.Swing(scene, model, settings) if self.kind == "harmonic" else None
        if self.swing:
            model = self.swing.still
        self.pulled = model if self.swing is None else self.swing.swinging or model
        self.scene, self.model, self.mesh = scene, model, mesh
        self.modes = settings.get("modes", {"modal": 10, "buckling": 1}.get(self.kind, 0))
        laws = [law for body in model.bodies for law in body.laws] + [
            solid.law for solid in model.solids if solid.law is not None
        ]
        self.linear = all(law.linear for law in laws)
        if not self.linear and any(law.linear for law in laws):
            raise InputError("laws of small and of large displacements in one scene are not written to .inp")
        self.moves = self.kind != "buckling" and not settings.get("at_rest", False)
        if self.kind in ("modal", "harmonic"):
            self._check_modes()
        elif self.kind == "buckling":
            self._check_buckling(settings)
        if self.kind != "statics" and model.contacts:
            raise InputError(f"contact 0: contact is written to .inp of statics alone, not of {self.kind}")
        self.large = not self.linear and self.moves
        if self.linear and model.following:
            raise InputError("a pressure that follows, and a law of small displacements, are not written to .inp")
        self.measured: list[str] = []
        if self.linear and model.spin is not None and any(model.spin.velocity):
            self.notes.append(
                "spin: forces are those at rest, in isorod where bodies are displaced: omega^2 / omega_1^2 more"
            )
        self.names = deck_names.names_of(scene, mesh)
        self.element, self.sets = element, sets
        self.held = held.all_of(mesh, model)
        self.means = deck_means.Means(scene, model, mesh)
        self.dead: Array = nodal.dead(mesh, model)
        self.warm: Array = deck_heat.temperatures(mesh, model)
        if model.times is not None and (self.warm.any() or any(one.turn.any() for one in model.motions)):
            raise InputError("end_time: temperatures and supports that turn over time are not written to .inp")
        if self.warm.any() and (self.kind == "buckling" or (self.kind != "statics" and self.moves)):
            raise InputError(f"{self.kind} of what is heated is not written to .inp, statics is")
        self.bodies = scene.bodies() if model.solids else []
        # Of several supports on a node the last one holds it, as in isorod.
        self.owner = np.full((len(mesh.points), 3), -1)
        for k, one in self.held.items():
            self.owner[one.nodes[:, None], one.components] = k

    def _check_buckling(self, settings: dict[str, Any]) -> None:
        """Refuse anything but loads that changes with the load factor: CalculiX scales the stress at rest."""
        if settings.get("linear_at"):
            raise InputError("linear_at: buckling about a loaded state is not written to .inp; linear_at = 0 is")
        if any(np.any(one.at(1.0)) for one in self.model.motions) or any(
            np.any(one.displacement) for one in self.model.means.values()
        ):
            raise InputError("buckling under supports that move is not written to .inp; load the rod by forces")
        if self.model.following:
            raise InputError("buckling under loads that follow the surface is not written to .inp")

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
        supports = {k: self.scene.named(f"support {k}") for k in range(len(self.model.supports))}
        loads = {k: self.scene.named(f"load {k}") for k in range(len(self.pulled.loads))}
        paired = [
            self.scene.named(f"{what} {k}")
            for what, several in (("tie", self.model.ties), ("contact", self.model.contacts))
            for k in range(len(several))
        ]
        bodies = [f"solid {one.name}" for one in self.bodies]
        deck_names.once([*supports.values(), *loads.values(), *paired, *bodies, *self.means.titles])
        self.supports, self.loads = ({k: abaqus.name_of(name) for k, name in one.items()} for one in (supports, loads))
        named = deck_names.renamed(self.mesh, self.names)
        self.solids = [
            deck_solids.mesh_of(one, solid, name)
            for one, solid, name in zip(self.bodies, self.model.solids, bodies, strict=True)
        ]
        elements = [self.element, *(map(deck_solids.element, self.bodies, self.model.solids))]
        dead = [self.dead, *(map(deck_solids.forces, self.solids, self.model.solids, bodies))]
        self.pairs = deck_joined.Pairs(self.scene, self.model, self.mesh, [named, *self.solids], self.names)
        joined = [*self.pairs.ties(), *self.pairs.contacts()]
        self.notes += [*self.pairs.notes, *self.means.notes]
        materials = [*self._materials()]
        for mesh in self.pairs.meshes[len(elements) :]:
            elements.append("C3D8" if mesh.order == 1 else abaqus.BRICKS[mesh.order])
            dead.append(np.zeros_like(mesh.points))
        self.blocks: list[_Block] = []
        text: list[str] = []
        cells = 0
        for mesh, element, forces in zip(self.pairs.meshes, elements, dead, strict=True):
            first = max((int(block.number.max()) for block in self.blocks), default=0)
            part, number = abaqus.lines(mesh, element, {} if self.blocks else self.sets, first, cells)
            cells += len(mesh.cells)
            text.append(part)
            self.blocks.append(_Block(mesh, element, number, forces))
        self.number = self.blocks[0].number
        last = max(int(block.number.max()) for block in self.blocks)
        own = [*self._sets(), *self.pairs.equations(self.number, self.owner >= 0), *self._means(last, cells)]
        own += self.pairs.turning(last + len(self.means.titles))
        steps = list(self._steps())
        notes = [f"** {one}" for one in self.notes]
        head = ["*HEADING", self.scene.title.encode("ascii", "replace").decode().lstrip("*"), *notes]
        return Deck(
            "\n".join(
                [*head, "** Nodes, elements, and sets of both", *text, *own, "** Laws", *materials, *joined, *steps]
            ),
            self.notes,
        )

    def _materials(self) -> Iterator[str]:
        """Yield materials and sections, and put their sets of elements to the others."""
        for kind in groups.kinds(self.mesh, self.model, self.names):
            if not kind.whole:
                self.sets[kind.name] = kind.cells
            yield from self._material(kind.name, kind.law, kind.density)
        for one, solid in zip(self.bodies, self.model.solids, strict=True):
            yield from self._material(f"solid {one.name}", solid.law, solid.density)
        for name, _ in self.pairs.obstacles:
            title = abaqus.name_of(name)
            yield from [f"*MATERIAL,NAME={title}", "*ELASTIC", "1.,0."]
            yield f"*SOLID SECTION,ELSET={title}_BRICKS,MATERIAL={title}"

    def _material(self, name: str, law: Any, density: float) -> Iterator[str]:
        """Yield the material of a set of elements, and its section."""
        words, note = (deck_laws.finite if self.large else deck_laws.elastic)(bare(law))
        if self.kind != "statics" and words[0].startswith("*HYPERELASTIC"):
            # Measured of a bar: its frequency is 2 % off if it is stretched by 0.5 %, 14 % if by 5 %.
            raise InputError(
                f"modes about a loaded state of law {type(law).__name__} are not written to .inp: CalculiX has other "
                "moduli there; those of StVenantKirchhoff, and with at_rest = true, are"
            )
        if isinstance(law, Thermal):
            words = [*words, *deck_heat.expansion(law)]
        if note:
            self.notes.append(f"{name}: {note}")
        title = abaqus.name_of(name)
        yield from [f"*MATERIAL,NAME={title}", *words]
        if density > 0.0:
            yield from ["*DENSITY", f"{density:.12g}"]
        yield f"*SOLID SECTION,ELSET={title},MATERIAL={title}"

    def _sets(self) -> Iterator[str]:
        """Yield the nodes of supports and of forces on ends, what supports tie, and the temperature at first."""
        if self.warm.any():
            yield from ["*INITIAL CONDITIONS,TYPE=TEMPERATURE", f"{abaqus.ALL_NODES},0."]
        at_ends = {k: (one.nodes, np.where(self.owner == k, self.dead, 0.0)) for k, one in self.held.items()}
        at_ends |= {k: (nodes, self.dead[nodes]) for k, nodes in self.means.nodes.items()}
        for k, (nodes, forces) in at_ends.items():
            yield from abaqus.set_of_nodes(self.supports[k], np.sort(self.number[nodes]))
            others = [own for j, (own, _) in at_ends.items() if j != k and {j, k} & self.means.nodes.keys()]
            if any(np.isin(nodes, own).any() for own in others):
                self.notes.append(f"{self.supports[k]}: the RF of CalculiX has those of supports on the same nodes")
            on = forces.sum(axis=0)
            if self.kind == "statics" and np.abs(on).max() > _ROUNDING * np.abs(self.dead).max():
                text = ", ".join(f"{value:.6g}" for value in on)
                self.notes.append(f"{self.supports[k]}: loads on its own nodes, ({text}), are in the RF of CalculiX")
        if self.swing:
            for name, node in deck_harmonic.places(self.scene, self.model, self.mesh, self.number):
                if not node:
                    self.notes.append(f"{name}: no node is there; another --level may have one")
                    continue
                self.measured.append(abaqus.name_of(name))
                yield from abaqus.set_of_nodes(self.measured[-1], np.array([node]))
        for k, load in enumerate(self.pulled.loads):
            if isinstance(load, SectionLoad):
                face = nodal.face_at(self.mesh, load.body, load.u, self.model)
                yield from abaqus.set_of_nodes(self.loads[k], np.unique(self.number[face]))
        for k, support in self.held.items():
            if support.tied and support.motion.turn.any():
                raise InputError(f"support {k}: a face that turns and is tied is not written to .inp")
            first, *others = self.number[support.nodes][self.number[support.nodes] > 0].tolist()
            for component in support.tied:
                for node in others:
                    yield from abaqus.equation([f"{node},{component + 1},1.", f"{first},{component + 1},-1."])

    def _means(self, last: int, cells: int) -> Iterator[str]:
        """Yield the supports of mean motions, behind so many nodes and elements."""
        taken = self.owner >= 0
        for one in self.held.values():
            taken[one.nodes[:, None], one.tied] = True
        yield from self.means.lines(self.number, taken, last, cells)

    def _steps(self) -> Iterator[str]:
        """Yield the steps: statics, as many as turns and timed motions need; then modes, and responses."""
        loads: list[str] | None = None
        if self.moves:
            stops = self._stops()
            for k, (factor, lines) in enumerate(zip(stops, self._loads(stops), strict=True), 1):
                loads = [*lines]
                yield f"** Step {k} of {len(stops)}: supports and loads at {self.model.when(factor)}"
                yield "*STEP,NLGEOM,INC=10000" if self.large else "*STEP"
                yield _STATIC if self.large or self.model.contacts else "*STATIC"
                yield from [*self._boundary(factor), *loads, *self._printed()]
        if self.kind == "buckling":
            part = self._fraction()
            self.notes.append(
                f"load factors are those of linear buckling, by the stress of the state of rest; loads are {part:g} "
                f"of the scene's, since CalculiX sees factors above 1 alone: multiply what it finds by {part:g}"
            )
            yield from ["** Load factors of linear buckling", "*STEP", "*BUCKLE", f"{self.modes + _MORE},{_ACCURACY}"]
            yield from self._boundary(0.0)
            yield from next(self._loads([part]))
            yield from ["*NODE FILE", "U", "*END STEP"]
        if self.kind in ("modal", "harmonic"):
            from isorod.checks.rigid_motions import moved_freely

            rigid = len(moved_freely(self.model))
            if self.swing:
                self.notes += self.swing.find()
                self.modes = self.swing.modes - rigid
            modes = self.modes + rigid + _MORE
            yield "** Frequencies, those of rigid motions first"
            yield "*STEP,PERTURBATION" if self.moves else "*STEP"
            yield from ["*FREQUENCY,STORAGE=YES" if self.swing else "*FREQUENCY", f"{modes}"]
            if rigid:
                self.notes.append(f"the first {rigid} modes are rigid motions")
            if not self.moves:
                yield from self._boundary(0.0)
            yield from ["*END STEP"] if self.swing else ["*NODE FILE", "U", "*END STEP"]
            if self.swing:
                pulled = [] if self.swing.swinging is None else [*next(self._loads([1.0], self.swing.swinging))]
                yield from self.swing.steps(modes, pulled, loads, [*self.measured, *self._sections()])

    def _loads(self, stops: list[float], model: Model | None = None) -> Iterator[Iterator[str]]:
        """Yield the lines of loads of each step, those of another model where one is given."""
        blocks = [(block.number, block.dead) for block in self.blocks]
        warm = self.warm if model is None else np.zeros_like(self.warm)
        return deck_loads.Loads(model or self.model, self.mesh, self.names, warm, blocks).steps(stops)

    def _sections(self) -> list[str]:
        """Return the sets of nodes of ends and sections that are pulled."""
        return [self.loads[k] for k, load in enumerate(self.pulled.loads) if isinstance(load, SectionLoad)]

    def _fraction(self) -> float:
        """Return the fraction of the loads, of one digit, whose lowest load factor is about 2."""
        from isorod import buckling

        lowest = float(buckling.solve(self.model, 1, linear_at=0.0).factors[0])
        return float(f"{0.5 * lowest:.0e}")

    def _stops(self) -> list[float]:
        """Return the load factors at which steps end."""
        if not self.large and self.model.times is None and not self.model.contacts:
            return [1.0]
        stops = {*self.model.stages}
        for one in self.model.motions:
            parts = max(ceil(np.degrees(np.linalg.norm(one.turn)) / ANGLE - 1e-6), len(one.path) - 1)
            begin, end = one.during
            stops |= {begin + (end - begin) * k / parts for k in range(1, parts + 1)}
        return sorted(stops - {0.0})

    def _boundary(self, factor: float) -> Iterator[str]:
        """Yield the supports' displacements: of all their nodes at once where they move alike, else of each node."""
        bodies = [(self.bodies[k].name, one) for k in range(len(self.bodies)) for one in self.bodies[k].held]
        means = [*self.means.held(factor)]
        if self.held or bodies or self.pairs.obstacles or means:
            yield "*BOUNDARY"
        yield from means
        for name, one in bodies:
            for component in ("xyz".index(letter) for letter in one.components):
                title = abaqus.name_of(f"solid {name} {one.group}")
                yield f"{title},{component + 1},{component + 1},{factor * one.displacement[component]:.12g}"
        for name, k in self.pairs.obstacles:
            yield from deck_pairs.moved(self.model.contacts[k], abaqus.name_of(name), factor)
        for k, support in self.held.items():
            moved = support.displacement(factor)
            for component in support.components:
                mine = self.owner[support.nodes, component] == k
                numbers, values = self.number[support.nodes], moved[:, component]
                dof = f"{component + 1},{component + 1}"
                if mine.all() and np.ptp(values) <= _ROUNDING * np.abs(moved).max():
                    yield f"{self.supports[k]},{dof},{values[0]:.12g}"
                    continue
                for node, value in zip(numbers[mine].tolist(), values[mine].tolist(), strict=True):
                    if node:
                        yield f"{node},{dof},{value:.12g}"

    def _printed(self) -> Iterator[str]:
        """Yield output requests: the forces of each support and their sum, the displacements where forces pull."""
        bodies = [abaqus.name_of(f"solid {one.name} {at.group}") for one in self.bodies for at in one.held]
        for title in [*self.supports.values(), *bodies]:
            yield from [f"*NODE PRINT,NSET={title},TOTALS=YES,FREQUENCY=10000", "RF"]
        for title in self.means.titles:
            yield from [f"*NODE PRINT,NSET={title},TOTALS=YES,FREQUENCY=10000", "U,RF"]
        for title in self._sections():
            yield from [f"*NODE PRINT,NSET={title},FREQUENCY=10000", "U"]
        yield from self.pairs.printed
        yield from ["*NODE FILE,FREQUENCY=10000", "U,RF", "*EL FILE,FREQUENCY=10000", "S,E", "*END STEP"]
