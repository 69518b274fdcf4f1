"""What every analysis takes: bodies (a space with a material) and supports."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isorod.disk import Array
from isorod.errors import InputError
from isorod.material import Material
from isorod.space import Space
from isorod.spline import Index


@dataclass(frozen=True, eq=False)
class Body:
    """A rod made of one material, with its displacement space; ``density`` is mass per reference volume."""

    space: Space
    material: Material
    density: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.density) and self.density >= 0.0):
            raise InputError(f"density: got {self.density:g}, need a finite mass per volume, not negative")


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
        Displacement at load factor 1, shape ``(3,)`` or one a node ``(m, 3)``, units of length; components that are not held
        are not read.
    body
        Index of the body in the model.
    """

    nodes: Index
    components: str = "xyz"
    displacement: ArrayLike = (0.0, 0.0, 0.0)
    body: int = 0

    @classmethod
    def end(
        cls,
        space: Space,
        which: str,
        components: str = "xyz",
        displacement: tuple[float, float, float] = (0.0, 0.0, 0.0),
        body: int = 0,
    ) -> "Support":
        """Return a support of the whole ``"start"`` or ``"end"`` face: every ``k`` is held, ``k = 0`` carries the displacement."""
        if space.rod.closed:
            raise InputError("support of an end: a closed rod has none")
        layers = {"start": 0, "end": space.layers - 1}
        if which not in layers:
            raise InputError(f"support: got end {which!r}, need 'start' or 'end'")
        nodes = layers[which] * space.layer_nodes + np.arange(space.layer_nodes)
        return cls(nodes, components, space.carries[nodes, None] * np.array(displacement, dtype=float), body)


@dataclass(frozen=True)
class Spin:
    """A steady rotation of the frame in which displacements are measured: centrifugal force, growing with the load factor.

    Parameters
    ----------
    velocity
        Angular velocity vector, radians per time, at load factor 1 (at factor ``f``, ``sqrt(f)`` times as fast).
    center
        A point on the axis of rotation.
    """

    velocity: tuple[float, float, float]
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not np.isfinite([*self.velocity, *self.center]).all():
            raise InputError(f"spin: velocity {self.velocity}, center {self.center}: both must be finite")

    @property
    def field(self) -> Array:
        """Matrix ``|w|^2 1 - w w^T`` that takes the position from the center to the centrifugal acceleration."""
        w = np.array(self.velocity)
        return w @ w * np.eye(3) - np.outer(w, w)


@dataclass(frozen=True, eq=False)
class Model:
    """Bodies and supports; degrees of freedom are numbered body by body, node by node, ``x, y, z``.

    Raises
    ------
    InputError
        If a support names a body, a node or a component that is not there, or two supports contradict each other.
    """

    bodies: Sequence[Body]
    supports: Sequence[Support] = ()
    spin: Spin | None = None
    first_node: Index = field(init=False)
    held: Index = field(init=False)
    values: Array = field(init=False)
    free: Index = field(init=False)
    support_of: Index = field(init=False)

    def __post_init__(self) -> None:
        for b, body in enumerate(self.bodies):
            if self.spin is not None and not body.density > 0.0:
                raise InputError(f"spin: body {b} has no density")
        counts = [body.space.nodes for body in self.bodies]
        first_node = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        values = np.full(3 * first_node[-1], np.nan)
        owner = np.full(values.size, -1)
        for k, support in enumerate(self.supports):
            dofs = self._dofs(support, k, first_node)
            wanted = self._wanted(support, k)
            clash = ~np.isnan(values[dofs]) & (values[dofs] != wanted)
            if clash.any():
                dof = dofs[np.argmax(clash)]
                raise InputError(
                    f"support {k}: node {dof // 3}, component {'xyz'[dof % 3]} is held elsewhere at another displacement"
                )
            values[dofs] = wanted
            owner[dofs] = k
        held = np.flatnonzero(~np.isnan(values))
        free = np.full(values.size, -1, dtype=np.int64)
        free[np.isnan(values)] = np.arange(values.size - held.size)
        for name, array in (
            ("first_node", first_node),
            ("held", held),
            ("values", values[held]),
            ("free", free),
            ("support_of", owner[held]),
        ):
            object.__setattr__(self, name, array)

    def _dofs(self, support: Support, k: int, first_node: Index) -> Index:
        if not 0 <= support.body < len(self.bodies):
            raise InputError(f"support {k}: body {support.body} is not one of the {len(self.bodies)} bodies")
        nodes = np.asarray(support.nodes, dtype=np.int64)
        bad = (nodes < 0) | (nodes >= self.bodies[support.body].space.nodes)
        if bad.any():
            raise InputError(f"support {k}: node {nodes[np.argmax(bad)]} is not in body {support.body}")
        letters = sorted(set(support.components))
        if not letters or set(letters) - set("xyz"):
            raise InputError(f"support {k}: got components {support.components!r}, need some of 'xyz'")
        columns = np.array(["xyz".index(letter) for letter in support.components])
        return (3 * (first_node[support.body] + nodes)[:, None] + columns).ravel()

    @staticmethod
    def _wanted(support: Support, k: int) -> Array:
        columns = ["xyz".index(letter) for letter in support.components]
        given = np.asarray(support.displacement, dtype=float)
        nodes = np.size(support.nodes)
        if given.shape not in ((3,), (nodes, 3)):
            raise InputError(f"support {k}: got displacements of shape {given.shape}, need (3,) or ({nodes}, 3)")
        wanted = np.broadcast_to(given, (nodes, 3))[:, columns]
        if not np.isfinite(wanted).all():
            bad = wanted[~np.isfinite(wanted)][0]
            raise InputError(f"support {k}: displacement {bad} is not finite")
        return wanted.ravel()

    @property
    def dofs(self) -> int:
        """Number of degrees of freedom, held ones included."""
        return self.free.size

    @property
    def unknowns(self) -> int:
        """Number of degrees of freedom that are not held."""
        return self.free.size - self.held.size

    @property
    def carries(self) -> NDArray[np.bool_]:
        """Whether a node moves with its rod (`Space.carries`), shape ``(nodes,)``."""
        return np.concatenate([body.space.carries for body in self.bodies])

    @property
    def whole_nodes(self) -> bool:
        """True if each node is free or held as a whole, so that matrices have blocks of 3."""
        free = np.count_nonzero((self.free >= 0).reshape(-1, 3), axis=1)
        return bool(((free == 0) | (free == 3)).all())

    def nodal(self, displacement: Array, body: int = 0) -> Array:
        """Return one body's part ``(nodes, 3)`` of a vector of all degrees of freedom."""
        return displacement.reshape(-1, 3)[self.first_node[body] : self.first_node[body + 1]]
