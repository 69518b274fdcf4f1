"""Supports: Dirichlet boundary conditions and prescribed motions."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Index, Numbers
from isorod.errors import InputError
from isorod.model.history import InTime, TimeTable, clock_of
from isorod.model.motion import SupportMotion
from isorod.model.patch import patch_nodes
from isorod.space.space import Space


@dataclass(frozen=True, eq=False)
class Support(InTime):
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
        Components, letters of ``"xyz"``, in which the nodes rotate as prescribed but translate freely, as one: their
        control points (`Space.is_control_point`) have a common unknown.
    space
        The space of the nodes, to check that the body has the same.
    during
        Load factors between which it moves, ``0 <= begin < end <= 1``: ``f`` above grows there from 0 to 1.
    waypoints
        Displacements at ``f`` = 1/s, 2/s, ..., (s - 1)/s, shape ``(s - 1, m, 3)``, linear between these; where not
        given, linear from zero to ``displacement``.
    spin
        Angular velocity in motions, radians per time, ``(3,)``, instead of ``displacement`` and ``turn``: nodes rotate
        about the centre of the ``arms`` all the time, with a ``history`` as a factor of the angular velocity.
    """

    nodes: Index
    components: str = "xyz"
    displacement: Numbers = (0.0, 0.0, 0.0)
    body: int = 0
    turn: Numbers = (0.0, 0.0, 0.0)
    arms: Numbers | None = None
    tied: str = ""
    space: Space | None = field(default=None, repr=False)
    during: tuple[float, float] = (0.0, 1.0)
    waypoints: Numbers | None = field(default=None, repr=False)
    spin: Numbers = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        spins, moves = np.any(self.spin), np.any(self.displacement) or np.any(self.turn)
        if spins and moves:
            raise InputError("spin: the support has a displacement or a rotation too; give one of them")
        if self.history is not None and not (spins or moves):
            raise InputError("history: the support does not move; give it a displacement, a rotation or a spin")
        if (self.history is not None or spins) and (tuple(self.during) != (0.0, 1.0) or self.waypoints is not None):
            raise InputError("during: what moves by time has no load factors; leave it out")
        if not spins and isinstance(self.history, TimeTable) and self.history.jumps:
            raise InputError("history: a support cannot jump from one place to another; give times that rise")

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
        during: tuple[float, float] = (0.0, 1.0),
        spin: tuple[float, float, float] = (0.0, 0.0, 0.0),
        history: Numbers | None = None,
    ) -> "Support":
        """Return a support of the whole ``"start"`` or ``"end"`` face: every node is held.

        With a ``turn`` the face moves as a rigid body: at factor ``f`` its point ``x`` is displaced by
        ``R(f turn) (x - c) - (x - c) + f displacement``.  In the components ``tied`` the face rotates too, but is free
        to translate as a whole; ``components`` are held, so that ``components="x", tied="yz"`` holds one translation of
        a rigid face.

        Parameters
        ----------
        space
            The body's space.
        which
            ``"start"`` or ``"end"``.
        components, tied
            Letters of ``"xyz"``.
        displacement
            At load factor 1, shape ``(3,)``, units of length.
        body
            Index of the body in the model.
        turn
            Rotation vector at load factor 1, shape ``(3,)``: along its axis, as long as its angle, which may be many
            full turns; radians, in scene files (`rotation`) degrees.
        center
            The point ``c``, shape ``(3,)``; the mean of the face's control points where not given.
        during
            Load factors between which it moves (`Support`).
        spin
            Angular velocity about the ``center`` in motions, radians per time, ``(3,)``.
        history
            In motions the factor by time of displacement, turn or spin, rows of time and factor
            (`isorod.model.history.InTime`).

        Raises
        ------
        InputError
            If the rod is closed, or has no such end.
        """
        nodes = np.arange(space.nodes).reshape(space.layers, -1)[space.end(which)]
        rest = {"components": components, "body": body, "tied": tied, "during": during, "spin": spin}
        return cls._rigid(nodes, space, displacement, turn, center, history=history, **rest)

    @classmethod
    def patch(
        cls,
        space: Space,
        around: tuple[float, float],
        along: tuple[float, float],
        components: str = "xyz",
        displacement: tuple[float, float, float] = (0.0, 0.0, 0.0),
        body: int = 0,
        turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
        center: tuple[float, float, float] | None = None,
        tied: str = "",
        during: tuple[float, float] = (0.0, 1.0),
        spin: tuple[float, float, float] = (0.0, 0.0, 0.0),
        history: Numbers | None = None,
    ) -> "Support":
        """Return a support of a patch of the lateral surface: every node whose function acts there is held.

        The patch moves exactly as prescribed.  Its surroundings move, too, within an arc of the section and, less and
        less, within ``degree`` elements: a small patch needs a fine space.

        Parameters
        ----------
        around
            Angles round the section, degrees, from the first counter-clockwise to the second, at most 360 more; angles
            of the disk, which are those of the section's first axis if that is a circle.
        along
            Lengths along the centre line, from the start, the first below the second.
        components, tied, displacement, body, turn, center, during, spin, history
            As for `end`.

        Raises
        ------
        InputError
            If an angle or a length is out of range, or the section functions have no control points on the surface.
        """
        nodes = patch_nodes(space, around, along)
        rest = {"components": components, "body": body, "tied": tied, "during": during, "spin": spin}
        return cls._rigid(nodes, space, displacement, turn, center, history=history, **rest)

    @classmethod
    def _rigid(
        cls, nodes: Index, space: Space, displacement: Numbers, turn: Numbers, center: Numbers | None, **rest: Any
    ) -> "Support":
        """Return a support of nodes that move as a rigid body; ``rest`` are its other fields."""
        is_control_point = space.is_control_point[nodes, None]
        arms = None
        if np.any(turn) or np.any(rest["spin"]):
            arms = space.positions[nodes]
            middle = arms[is_control_point[:, 0]].mean(axis=0) if center is None else np.array(center, dtype=float)
            arms = arms - is_control_point * middle
        moved = is_control_point * np.array(displacement, dtype=float)
        return cls(nodes, displacement=moved, turn=turn, arms=arms, space=space, **rest)

    def motion(self, space: Space, first_node: int) -> "SupportMotion":
        """Return the prescribed motion of degrees of freedom of a space that starts with node ``first_node``.

        Raises
        ------
        InputError
            If a node or a component is not there, or a displacement, turn or arm is not of its shape or not finite.
        """
        nodes = np.asarray(self.nodes, dtype=np.int64)
        if not nodes.size:
            raise InputError(f"got no nodes of body {self.body}, need at least one")
        bad = (nodes < 0) | (nodes >= space.nodes)
        if bad.any():
            raise InputError(f"node {nodes[np.argmax(bad)]} is not in body {self.body}")
        letters = self.components + self.tied
        if not letters or set(letters) - set("xyz"):
            raise InputError(f"got components {letters!r}, need some of 'xyz'")
        if set(self.components) & set(self.tied):
            raise InputError(f"components {self.components!r} held and {self.tied!r} tied, need one or the other")
        columns = np.array(["xyz".index(letter) for letter in letters])
        tied = np.array([letter in self.tied for letter in letters]) & space.is_control_point[nodes, None]
        given = np.asarray(self.displacement, dtype=float)
        if given.shape not in ((3,), (nodes.size, 3)):
            raise InputError(f"got displacements of shape {given.shape}, need (3,) or ({nodes.size}, 3)")
        rates = np.broadcast_to(given, (nodes.size, 3))[:, columns]
        if not np.isfinite(rates).all():
            raise InputError(f"displacement {rates[~np.isfinite(rates)][0]} is not finite")
        turn = np.asarray(self.turn, dtype=float)
        if turn.shape != (3,) or not np.isfinite(turn).all():
            raise InputError(f"got turn {turn.tolist()}, need three finite components in radians")
        during = self._period()
        spin = np.asarray(self.spin, dtype=float)
        if spin.shape != (3,) or not np.isfinite(spin).all():
            raise InputError(f"got spin {spin.tolist()}, need three finite components in radians per time")
        dofs = 3 * (first_node + nodes)[:, None] + columns
        clock = clock_of(self.history, bool(spin.any()))
        arms = self._turned(space, nodes, tied)
        path = self._path(rates, columns)
        path = np.where(tied, 0.0, path).reshape(len(path), -1)
        return SupportMotion(dofs.ravel(), path, arms.reshape(-1, 3), turn + spin, tied.ravel(), during, clock)

    def _path(self, last: Array, columns: Index) -> Array:
        """Return displacements of all components at ``f = 0, 1/s, ..., 1``, zero at first, ``(s + 1, m, c)``."""
        between = np.zeros((0, len(last), 3)) if self.waypoints is None else np.asarray(self.waypoints, dtype=float)
        if between.ndim != 3 or between.shape[1:] != (len(last), 3) or not np.isfinite(between).all():
            raise InputError(f"got waypoints of shape {between.shape}, need (count, {len(last)}, 3) finite numbers")
        return np.stack([np.zeros_like(last), *between[:, :, columns], last])

    def _period(self) -> tuple[float, float]:
        given = np.asarray(self.during, dtype=float)
        if given.shape != (2,) or not 0.0 <= given[0] < given[1] <= 1.0:
            raise InputError(f"got during {self.during!r}, need two load factors that rise, between 0 and 1")
        return float(given[0]), float(given[1])

    def _turned(self, space: Space, nodes: Index, tied: NDArray[np.bool_]) -> Array:
        """Return the arms of all components ``(m, c, 3)``, of ``tied`` ones ``(m, c)`` from the first control point."""
        result = np.zeros((*tied.shape, 3))
        if self.arms is None:
            return result
        arms = np.asarray(self.arms, dtype=float)
        if arms.shape != (nodes.size, 3) or not np.isfinite(arms).all():
            raise InputError(f"got arms of shape {arms.shape}, need ({nodes.size}, 3) finite numbers")
        result += arms[:, None]
        if tied.any():
            result[tied] -= arms[np.argmax(space.is_control_point[nodes])]
        return result


def center_of(space: Space, support: Support) -> Array:
    """Return the centre of a support's rotation, shape ``(3,)``."""
    nodes = np.asarray(support.nodes)
    k = int(np.argmax(space.is_control_point[nodes]))
    return np.asarray(space.positions[nodes[k]] - np.asarray(support.arms)[k])
