"""Loads of a scene in an input file: dead ones as forces on nodes, pressures that follow, the spin, temperatures."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from isorod.model.load import Pressure
from isorod.model.model import Model
from meshes import abaqus, deck_heat, nodal
from meshes.mesh import Array, Index, Mesh

# Forces below this fraction of the largest are rounding.
_ROUNDING = 1e-12


class Loads:
    """Loads at load factors, by a mesh of rods and the forces on other bodies.

    Parameters
    ----------
    model, mesh, names
        The model, the mesh of its rods, and what these are called (`meshes.deck_names.names_of`).
    warm
        Temperatures of the mesh's nodes at load factor 1, shape ``(nodes,)``.
    blocks
        The numbers of nodes in the file, and forces on these at load factor 1, of rods and of each other body.
    """

    def __init__(
        self, model: Model, mesh: Mesh, names: Mapping[str, str], warm: Array, blocks: Sequence[tuple[Index, Array]]
    ) -> None:
        self.model, self.mesh, self.names, self.warm, self.blocks = model, mesh, names, warm, blocks

    def steps(self, stops: Sequence[float]) -> Iterator[Iterator[str]]:
        """Yield the lines of each of several steps that end at these load factors.

        A force that is in one of the steps is in all: CalculiX keeps loads that a step does not mention.
        """
        rods = [nodal.dead(self.mesh, self.model, factor) for factor in stops]
        most = [np.max(np.abs(rods), axis=0), *(np.abs(forces) for _, forces in self.blocks[1:])]
        largest = max(float(one.max(initial=0.0)) for one in most)
        where = [np.nonzero(one > _ROUNDING * largest) for one in most]
        for factor, own in zip(stops, rods, strict=True):
            fraction = self.model.amplitude(None, factor)
            dead = [own, *(fraction * forces for _, forces in self.blocks[1:])]
            yield self._step(factor, [(at, one[at]) for at, one in zip(where, dead, strict=True)])

    def _step(self, factor: float, dead: Sequence[tuple[tuple[Index, ...], Array]]) -> Iterator[str]:
        """Yield the loads of a step: of each block rows and components of nodes, and the forces there."""
        if any(values.size for _, values in dead):
            yield "*CLOAD"
        for (number, _), ((rows, components), values) in zip(self.blocks, dead, strict=True):
            for row, component, value in zip(rows.tolist(), components.tolist(), values.tolist(), strict=True):
                yield f"{number[row]},{component + 1},{value:.12g}"
        for load in (one for one in self.model.following if isinstance(one, Pressure)):
            rod, k, surface = nodal.face_of(load).split(" ")
            title = abaqus.name_of(f"{self.names[f'{rod} {k}']} {surface}")
            yield from ["*DSLOAD", f"{title},P,{self.model.amplitude(load.history, factor) * load.pressure:.12g}"]
        if self.warm.any():
            yield from deck_heat.lines("*TEMPERATURE", self.blocks[0][0], factor * self.warm)
        spin = self.model.spin
        if spin is not None and any(spin.velocity):
            speed = float(np.linalg.norm(spin.velocity))
            axis = ",".join(f"{one:.12g}" for one in [*spin.center, *(np.array(spin.velocity) / speed)])
            force = self.model.amplitude(spin.history, factor) * speed**2
            yield from ["*DLOAD", f"{abaqus.ALL_ELEMENTS},CENTRIF,{force:.12g},{axis}"]
