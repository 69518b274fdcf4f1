"""Results of buckling: load factors, shapes, errors."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.checks.estimate_of_modes import Softening, of_factors
from isorod.errors import whole_number
from isorod.modal.mode import Shape
from isorod.model.load import BodyForce, Pressure, SectionLoad
from isorod.model.model import Model
from isorod.output.largest import Field, largest
from isorod.output.state import Deformation, State


@dataclass(frozen=True, eq=False, repr=False)
class BucklingMode(Shape):
    """A shape that a model buckles into, its largest displacement 1.

    Attributes
    ----------
    factor
        Its load factor.
    place
        Where its displacement is largest: ``body``, ``u``, ``angle`` in degrees and ``radius`` on the disk.
    """

    factor: float = field(kw_only=True)
    place: dict[str, float] = field(kw_only=True)

    def __repr__(self) -> str:
        return f"BucklingMode {self.number} of {self.model!r}\n  load factor {self.factor:.6g}"

    @property
    def _words(self) -> str:
        return f"buckling mode {self.number}, load factor {self.factor:.5g}"


@dataclass(frozen=True, eq=False)
class BucklingModes:
    """Load factors at which a model buckles, ascending: ``modes[k]`` is the `BucklingMode` ``k``.

    Attributes
    ----------
    model
        What was solved.
    factors
        Load factors, shape ``(modes,)``: multipliers of loads and support displacements.
    linear
        Those of the state of rest, shape ``(modes,)`` or fewer; none of the mixed formulation.
    vectors
        Shapes on all degrees of freedom, shape ``(modes, dofs)``; the largest displacement is 1, positive.
    places
        Where displacements are largest: ``body``, ``u``, ``angle`` in degrees and ``radius`` on the disk.
    residuals
        Of the vibration mode that becomes each shape, next to its factor, ``|K x - lambda M x| / (lambda_0 |M x|)``
        with the first ``lambda_0`` of the state of rest, shape ``(modes,)``; at rest ``|K x + f K' x| / |f K' x|``.
    settled
        Last relative change of the factors; None where all are computed at one equilibrium.
    below
        Number of factors below each, by the inertia of the tangent near it (Sturm count).
    states
        The equilibrium at each factor, or its linear extrapolation from the one at which they are computed.
    losses
        By how much the stiffness ``x^T K x`` of each shape falls with the load factor, shape ``(modes,)``.
    softening
        Data of the error estimate: each shape at an equilibrium short of its factor; none for factors computed at rest.
    linear_at
        The load factor of the equilibrium at which they are computed; None where each is computed at its own.
    equilibria, newton_iterations
        Number of equilibria, and of linear solves to reach these.
    seconds
        ``setup``, ``assembly``, ``solve`` and, for Sturm counts, ``check``, wall time.
    built, solver, ranks
        As for `isorod.statics.Equilibrium`.
    """

    model: Model
    factors: Array
    linear: Array
    vectors: Array
    places: Sequence[dict[str, float]]
    residuals: Array
    settled: float | None
    below: Sequence[int]
    states: Sequence[State]
    losses: Array
    softening: Sequence[Softening]
    linear_at: float | None
    equilibria: int
    newton_iterations: int
    seconds: dict[str, float]
    built: list[str]
    solver: dict[str, str]
    ranks: int

    @property
    def factor(self) -> float:
        """The lowest load factor, that of the state whose fields are shown."""
        return float(self.factors[0])

    def __len__(self) -> int:
        return self.factors.size

    def __getitem__(self, number: int) -> BucklingMode:
        """Return a mode, the first by 0, the last by -1; raises `InputError`."""
        k = whole_number("mode", number, -len(self), len(self) - 1) % len(self)
        factor, place = float(self.factors[k]), self.places[k]
        return BucklingMode(self.model, self.vectors[k], k, self.states[k].displacement, factor=factor, place=place)

    def __iter__(self) -> Iterator[BucklingMode]:
        return (self[k] for k in range(len(self)))

    def __repr__(self) -> str:
        values = ", ".join(f"{one:.6g}" for one in self.factors[:6])
        return (
            f"BucklingModes of {self.model!r}\n  about {self.about}\n  {len(self)} load factors {values}, residuals up "
            f"to {self.residuals.max():.3g}"
        )

    @property
    def about(self) -> str:
        """The equilibrium of the tangent stiffness, as text."""
        if self.linear_at is None:
            return "the equilibrium at each load factor"
        place = f"the equilibrium at load factor {self.linear_at:g}" if self.linear_at else "the state of rest"
        return f"{place} (linear)"

    @cached_property
    def loads(self) -> tuple[str, Array] | None:
        """Critical values ``(modes,)`` of the only load or moved support, with its description; None with several."""
        moved = [k for k, one in enumerate(self.model.motions) if one.path.any() or one.turn.any()]
        if len(self.model.loads) + len(moved) != 1:
            return None
        if moved:
            motion = self.model.motions[moved[0]]
            if motion.turn.any():
                alone = not motion.path.any()
                size = float(np.degrees(np.linalg.norm(motion.turn)))
                return (f"rotation of support {moved[0]}, degrees", size * self.factors) if alone else None
            given = np.asarray(self.model.supports[moved[0]].displacement, dtype=float)
            size = float(np.linalg.norm(given, axis=-1).max())
            return f"displacement of support {moved[0]}", size * self.factors
        load = self.model.loads[0]
        for kind, word, name in (
            (SectionLoad, "force", "force"),
            (Pressure, "pressure", "pressure"),
            (BodyForce, "force per volume", "density"),
        ):
            if isinstance(load, kind):
                return f"{word} of load 0", float(np.linalg.norm(getattr(load, name))) * self.factors
        return None

    def estimate(self, *directions: str) -> float | None:
        """Return an estimate of the factors' largest relative error (`isorod.checks.estimate_of_modes`).

        None where there is none, as for factors computed at rest.  It takes about as long as the factors.  It is the
        sum of those across the ``"section"`` and along the ``"axis"``, or that of one direction given.
        """
        from isorod.checks import embedded

        heavy = self.model.of_density(1.0)
        error = of_factors(heavy, self.softening, directions, self.ranks)
        return error if error is None or directions else error + embedded.of(self).error

    def shapes(self) -> Iterator[tuple[float, Array]]:
        """Yield each shape with its energy: the load factor lacks the fraction that is missing there."""
        for factor, loss, vector in zip(self.factors, self.losses, self.vectors, strict=True):
            yield 0.5 * float(factor * loss), vector

    def record(self) -> dict[str, Any]:
        """Return the entries of a record."""
        kept = ("about", "linear", "residuals", "settled", "below", "equilibria", "newton_iterations")
        record = {name: getattr(self, name) for name in kept} | {"largest": self.places}
        if self.loads is not None:
            record["critical_load"], record["critical_loads"] = self.loads
        return record

    def frames(self) -> "list[tuple[float, BucklingModes]]":
        """Return the frames of a picture: these modes."""
        return [(0.0, self)]

    def curves(self) -> dict[str, Array]:
        """Return number, load factor and residual of the modes, one row each."""
        numbers = np.arange(1.0, len(self) + 1.0)
        return {"mode": numbers, "load factor": self.factors, "residual": self.residuals}

    def fields(self, body: int) -> dict[str, Array]:
        """Return a body's part of each shape, ``(nodes, 3)``, and the fields of the equilibrium at the first factor."""
        fields = self.states[0].fields(body)
        return fields | {f"mode_{k + 1}": self.model.nodal(one, body) for k, one in enumerate(self.vectors)}


def scaled(model: Model, vector: Array) -> tuple[float, dict[str, float]]:
    """Return the factor that scales the largest displacement of a shape ``(dofs,)`` to 1, and the place of that.

    Of several places of equal size the first is taken; the largest component is positive there.
    """
    shape = Deformation(model, vector)

    def sizes(b: int) -> Field:
        return lambda u, xi: np.linalg.norm(shape.at(b, u, xi), axis=-1)

    peaks = [largest(body.space, sizes(b))[0] for b, body in enumerate(model.bodies)]
    body = int(np.argmax([place.value * (1.0 + 1e-9 * (len(peaks) - k)) for k, place in enumerate(peaks)]))
    peak = peaks[body]
    there = shape.at(body, peak.u, peak.xi)
    sign = np.sign(there[np.argmax(np.abs(there))])
    place = {
        "body": float(body),
        "u": float(peak.u),
        "angle": float(np.degrees(np.arctan2(peak.xi[1], peak.xi[0]))),
        "radius": float(np.linalg.norm(peak.xi)),
    }
    return float(sign / peak.value), place
