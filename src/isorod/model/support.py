"""Supports, and the motions they prescribe."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.space.space import Space


@dataclass(frozen=True, eq=False)
class Support:
    """Prescribed displacements of nodes.

    Parameters
    ----------
    nodes
        Node numbers in the body's space, shape ``(m,)``.
    components
        Held components, letters of ``"xyz"``.
    displacement
        Displacement at load factor 1, shape ``(3,)`` or one a node ``(m, 3)``, units of length; components that are not
        held are not read.
    body
        Index of the body in the model.
    turn
        Rotation vector at load factor 1, radians, of any length; at factor ``f`` the nodes' displacement is
        ``f displacement + (R(f turn) - 1) arm`` with the exact rotation ``R``.
    arms
        Coefficients of the position from the centre of that rotation, shape ``(m, 3)``; zero where not given.
    tied
        Components, letters of ``"xyz"``, in which the nodes turn with the others but translate freely, as one: those
        that carry the rod (`Space.is_carrier`) share one unknown.
    """

    nodes: Index
    components: str = "xyz"
    displacement: ArrayLike = (0.0, 0.0, 0.0)
    body: int = 0
    turn: ArrayLike = (0.0, 0.0, 0.0)
    arms: ArrayLike | None = None
    tied: str = ""

    @classmethod
    def end(
        cls,
        space: Space,
        which: str,
        components: str = "xyz",
        displacement: tuple[float, float, float] = (0.0, 0.0, 0.0),
        body: int = 0,
        turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
        center: tuple[float, float, float] | None = None,
        tied: str = "",
    ) -> "Support":
        """Return a support of the whole ``"start"`` or ``"end"`` face: every ``k`` is held, ``k = 0`` carries the displacement.

        With a ``turn`` (rotation vector, radians at load factor 1) the face moves as a rigid body: at factor ``f`` its
        point ``x`` is displaced by ``R(f turn) (x - c) - (x - c) + f displacement``; the ``center`` ``c`` is the mean
        of the face's nodes where not given.  In the components ``tied`` the face turns too, but is free to translate as
        a whole; ``components`` are those held, so that ``components="x", tied="yz"`` holds one translation of a rigid
        face.
        """
        if space.rod.closed:
            raise InputError("support of an end: a closed rod has none")
        layers = {"start": 0, "end": space.layers - 1}
        if which not in layers:
            raise InputError(f"support: got end {which!r}, need 'start' or 'end'")
        nodes = layers[which] * space.layer_nodes + np.arange(space.layer_nodes)
        carries = space.is_carrier[nodes, None]
        arms = None
        if np.any(turn):
            arms = space.positions[nodes]
            middle = arms[carries[:, 0]].mean(axis=0) if center is None else np.array(center, dtype=float)
            arms = arms - carries * middle
        return cls(nodes, components, carries * np.array(displacement, dtype=float), body, turn, arms, tied)


def rotation(vector: ArrayLike) -> Array:
    """Return the matrix ``(3, 3)`` of the rotation about ``vector`` by its length, radians (Rodrigues).

    Its entries for directions in the axis are exact: a rotation about ``y`` leaves ``y`` components as they are.
    """
    return np.eye(3) + turning(vector)


def turning(vector: ArrayLike) -> Array:
    """Return `rotation` less the identity, accurate for small angles too."""
    x, y, z = np.asarray(vector, dtype=float)
    angle = float(np.sqrt(x * x + y * y + z * z))
    if angle == 0.0:
        return np.zeros((3, 3))
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) / angle
    return np.sin(angle) * cross + 2.0 * np.sin(0.5 * angle) ** 2 * (cross @ cross)


class SupportMotion(NamedTuple):
    """What one support does with degrees of freedom ``dofs`` ``(m,)``.

    At load factor ``f`` component ``a`` of ``f rate + (R(f turn) - 1) arm`` is the displacement of those that are held,
    and what those that are ``tied`` have more than the unknown they share (one a component).
    """

    dofs: Index
    rates: Array
    arms: Array
    turn: Array
    tied: NDArray[np.bool_]

    def at(self, factor: float) -> Array:
        """Return the prescribed part of the displacements at a load factor, shape ``(m,)``."""
        result = factor * self.rates
        if self.turn.any():
            rows = turning(factor * self.turn)[self.dofs % 3]
            result = result + np.einsum("ma,ma->m", rows, self.arms)
        return result
