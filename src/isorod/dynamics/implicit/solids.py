"""Finite element bodies in motion: their state, and quantities for outputs and balances."""

from collections.abc import Iterable, Sequence
from hashlib import sha256
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.model.model import Model

if TYPE_CHECKING:
    from isorod.dynamics.implicit.coupling import StepCoupling
    from isorod.fenics.solid import Solid


class Solids:
    """The finite element bodies of a model in motion, if any; collective, with the same on every rank.

    Attributes
    ----------
    displacement, velocity
        All their degrees of freedom, concatenated, shape ``(s,)``.
    held
        Whether a condition holds a degree of freedom, ``(s,)``.
    work
        Work of the internal forces of bodies given by a form, whose stored energy is unknown, ``(1,)``.
    active
        Whether one of their laws has activation.
    size
        Sum of their moduli times volumes.
    """

    def __init__(self, model: Model, coupling: "StepCoupling | None") -> None:
        self._solids, self._coupling, rods = model.solids, coupling, model.dofs
        self._own = [] if coupling is None else [own - rods for own in coupling.own_dofs]
        self.held = np.zeros(0, dtype=bool) if coupling is None else coupling.constraints.held[rods:]
        self.displacement, self.velocity = np.zeros((2, self.held.size))
        self.work = np.zeros(1)
        self.active = any(solid.law is not None and solid.law.activation_work > 0.0 for solid in self._solids)
        self.size = sum(solid.law.modulus * solid.volume for solid in self._solids if solid.law is not None)

    def own(self, everywhere: Array) -> list[Array]:
        """Return this rank's degrees of freedom of each body."""
        return [everywhere[own] for own in self._own]

    def _everywhere(self, own: Iterable[Array]) -> Array:
        return np.zeros(0) if self._coupling is None else self._coupling.everywhere([*own])

    def momenta(self, velocity: Array) -> Array:
        """Return mass times velocity, ``(s,)`` both."""
        pairs = zip(self._solids, self.own(velocity), strict=True)
        return self._everywhere(solid.momenta(v) for solid, v in pairs)

    def internal(self, displacement: Array, level: float) -> Array:
        """Return the internal forces in a state, ``(s,)``."""
        pairs = zip(self._solids, self.own(displacement), strict=True)
        return self._everywhere(solid.internal(u, level) for solid, u in pairs)

    def loads(self, displacement: Array) -> Array:
        """Return the forces of loads in a state, ``(s,)``."""
        return self._everywhere(solid.loads(u) for solid, u in zip(self._solids, self.own(displacement), strict=True))

    def energies(self, displacement: Array) -> tuple[float, float]:
        """Return the energy stored by laws without activation, and that added by full activation."""
        pairs = [
            (solid, u) for solid, u in zip(self._solids, self.own(displacement), strict=True) if solid.law is not None
        ]
        stored = sum(solid.energy(u, 0.0) for solid, u in pairs)
        return stored, sum(solid.energy(u, 1.0) for solid, u in pairs) - stored if self.active else 0.0

    def worst(self) -> str:
        """Return a message with the smallest ``det F`` of each body."""
        determinants = [
            solid.smallest_jacobian(u) for solid, u in zip(self._solids, self.own(self.displacement), strict=True)
        ]
        return "".join(f", {det:.3g} in solid {k}" for k, det in enumerate(determinants))

    def add_work(self, change: Array) -> None:
        """Add to ``work`` that of a step with a displacement increment."""
        if self._coupling is None:
            return
        for solid, step, moved in zip(self._solids, self._coupling.steps, self.own(change), strict=True):
            if solid.law is None:
                self.work += solid.comm.allreduce(float(step.forces(moved, 1.0)[1] @ moved))

    def digest(self) -> str:
        """Return a digest of these bodies and their numbering."""
        digest = sha256()
        for solid in self._solids:
            sheared = 0.01 * np.roll(solid.positions, 1, axis=1).ravel()
            held = solid.held
            own = (solid.positions, *held, solid.residual(sheared, 0.5), solid.momenta(sheared), solid.loads(sheared))
            here = b"".join(np.ascontiguousarray(array).tobytes() for array in own)
            for part in solid.comm.allgather(sha256(here).digest()):
                digest.update(part)
        return digest.hexdigest()

    def move(self, change: Array, velocity: Array) -> None:
        """Add to the displacement, and set the velocity."""
        self.displacement += change
        self.velocity[:] = np.where(self.held, 0.0, velocity)


def resultant(forces: Array) -> Array:
    """Return the sum of forces on solids, ``(3,)``: their functions are a partition of unity."""
    return np.asarray(forces.reshape(-1, 3).sum(axis=0))


def initial(solids: "Sequence[Solid]", given: Sequence[tuple[ArrayLike, ArrayLike]]) -> tuple[Array, Array]:
    """Return displacement and velocity of all degrees of freedom of solids, ``(s,)`` each, at rest by default.

    Parameters
    ----------
    given
        Both of each solid, on this rank, as for `isorod.dynamics.solve`.

    Raises
    ------
    InputError
        If their number or a shape is wrong.
    """
    if given and len(given) != len(solids):
        raise InputError(f"initial state of solids: got {len(given)} pairs, need one for each of {len(solids)}")
    vectors: list[list[Array]] = [[np.zeros(0)], [np.zeros(0)]]
    for k, (solid, pair) in enumerate(zip(solids, given or [(0.0, 0.0)] * len(solids), strict=True)):
        for name, value, into in zip(("displacement", "velocity"), pair, vectors, strict=True):
            values, own = np.array(value, dtype=float), 3 * len(solid.positions)
            fits = values.shape in ((), (3,), (own,)) and bool(np.isfinite(values).all())
            if not all(solid.comm.allgather(fits)):
                raise InputError(
                    f"initial {name} of solid {k}: got shape {values.shape}, need ({own},) or (3,) finite numbers"
                )
            everywhere = values if values.shape == (own,) else np.broadcast_to(values, (own // 3, 3)).ravel()
            into.append(np.concatenate(solid.comm.allgather(everywhere)))
    displacement, velocity = (np.concatenate(parts) for parts in vectors)
    return displacement, velocity
