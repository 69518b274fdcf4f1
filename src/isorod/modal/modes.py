"""Results of modal analysis: frequencies, shapes, errors."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array
from isorod.errors import whole_number
from isorod.modal.mode import Mode
from isorod.model.model import Model
from isorod.statics.analysis import Equilibrium

if TYPE_CHECKING:
    from isorod.contact.result import ContactResult
    from isorod.output.matrices import Matrices
    from isorod.statics.differences import Derivatives


@dataclass(frozen=True, eq=False)
class Modes:
    """Vibration modes, ascending: ``modes[k]`` is the `Mode` ``k``, which is evaluated at any point.

    Attributes
    ----------
    model
        What was solved.
    frequencies
        ``omega / 2 pi``, cycles per time, shape ``(modes,)``; of an unstable state negative,
        ``-sqrt(-omega^2) / 2 pi``.
    eigenvalues
        ``omega^2``, shape ``(modes,)``; the rigid modes of a free body come first, near zero.
    vectors
        Mode shapes on all degrees of freedom, shape ``(modes, dofs)``, ``x^T M x = 1``.
    residuals
        ``|K x - lambda M x| / (|lambda| |M x|)``, shape ``(modes,)``; for rigid modes with the first flexible
        ``lambda``.
    rigid
        Number of rigid modes among them.
    below
        Number of eigenvalues up to and including the last one returned, by the inertia of ``K - tau M`` (Sturm count).
    shift
        Shift of the spectral transformation.
    iterations
        Restarts of the eigensolver in all rounds.
    seconds
        Wall times ``setup``, ``assembly``, ``solve`` and, for the Sturm count, ``check``; ``equilibrium`` if solved
        for.
    built, solver, ranks
        As for `isorod.statics.Equilibrium`.
    equilibrium
        The equilibrium about which they are, or None for the state of rest.
    about
        The same as text.
    quarter
        Of a spinning body, in the rotating frame: shapes a quarter of a period later, shape ``(modes, dofs)``; at time
        ``t`` it is ``vectors cos(omega t) + quarter sin(omega t)``, and the sum of both ``x^T M x`` is 1.
    falling
        Of a spinning body the number of negative eigenvalues of its stiffness, as beyond a critical speed.
    lumped
        Whether the mass matrix is lumped.
    patches
        `contact_error` of models with finite element bodies, None of others.
    solids
        Of each finite element body the shapes of its degrees of freedom on this rank, ``(modes, 3 nodes)``.
    """

    model: Model
    frequencies: Array
    eigenvalues: Array
    vectors: Array
    residuals: Array
    rigid: int
    below: int
    shift: float
    iterations: int
    seconds: dict[str, float]
    built: list[str]
    solver: dict[str, str]
    ranks: int
    equilibrium: Equilibrium | None = None
    about: str = "the state of rest"
    quarter: Array | None = None
    falling: int = 0
    lumped: bool = False
    patches: float | None = None
    solids: Sequence[Array] = ()

    @property
    def state(self) -> Array | None:
        """Displacement about which they are, shape ``(dofs,)``, or None for the state of rest."""
        return None if self.equilibrium is None else self.equilibrium.displacement

    @property
    def contacts(self) -> "Sequence[ContactResult]":
        """Result of each contact in the equilibrium about which they are."""
        return () if self.equilibrium is None else self.equilibrium.contacts

    def __len__(self) -> int:
        return self.frequencies.size

    def __getitem__(self, number: int) -> Mode:
        """Return a mode: 0 is the first (of a free body a rigid one), -1 the last; raises `InputError`."""
        k = whole_number("mode", number, -len(self), len(self) - 1) % len(self)
        later = None if self.quarter is None else self.quarter[k]
        solids = [one[k] for one in self.solids]
        frequency = float(self.frequencies[k])
        return Mode(self.model, self.vectors[k], k, self.state, later, solids, frequency=frequency)

    def __iter__(self) -> Iterator[Mode]:
        return (self[k] for k in range(len(self)))

    def __repr__(self) -> str:
        values = ", ".join(f"{one:.6g}" for one in self.frequencies[:6])
        more = ", ..." if self.frequencies.size > 6 else ""
        return (
            f"Modes of {self.model!r}\n  about {self.about}\n"
            f"  {self.frequencies.size} modes, {self.rigid} of them rigid, residuals up to "
            f"{self.residuals.max():.3g}\n  frequencies {values}{more}"
        )

    def estimate(self, *directions: str) -> float | None:
        """Return an estimate of the frequencies' largest relative error (`isorod.checks.estimate_of_modes`), or None.

        It takes about as long as the modes.  It is the sum of those across the ``"section"`` and along the ``"axis"``,
        of `contact_error`, and of the error of finite element bodies by recovered strains; or of one direction alone.
        Collective with such bodies.
        """
        from isorod.checks import embedded
        from isorod.checks.estimate_of_modes import Spectrum, of_modes

        modes = self.eigenvalues[self.rigid :], self.vectors[self.rigid :], self.rigid > 0, self.lumped
        solids = [one[self.rigid :] for one in self.solids]
        spectrum = Spectrum(*modes, self.equilibrium, self.quarter, solids)
        error = of_modes(self.model, spectrum, directions, self.ranks)
        if self.model.solids and not directions:
            # With contact the rods' part is not known, and not counted.
            rods, meshes = 0.0 if self.model.contacts else error, self._of_solids[0]
            error = None if rods is None or meshes is None else rods + meshes
        return error if error is None or directions else error + self.contact_error() + embedded.of(self).error

    @property
    def coarsest(self) -> Array | None:
        """Position of the largest error of frequencies in finite element bodies, ``(3,)``; None without an estimate."""
        return self._of_solids[1] if self.model.solids else None

    @cached_property
    def _of_solids(self) -> tuple[float | None, Array | None]:
        from isorod.checks.estimate_of_modes import of_solids

        about = () if self.equilibrium is None else self.equilibrium.solids
        solids = [one[self.rigid :] for one in self.solids]
        return of_solids(self.model, self.eigenvalues[self.rigid :], solids, about)

    def shapes(self) -> Iterator[tuple[float, Array]]:
        """Yield flexible modes with twice their energy, whose relative error is twice that of the frequency."""
        for value, vector in zip(self.eigenvalues[self.rigid :], self.vectors[self.rigid :], strict=True):
            yield abs(float(value)), vector

    def contact_error(self) -> float:
        """Return a bound on the frequencies' relative error by the compliance of contact patches; 0 without contact."""
        if self.equilibrium is None or not self.contacts:
            return 0.0
        if self.patches is not None:
            return self.patches
        from isorod.modal import touching

        modes = self.eigenvalues[self.rigid :], self.vectors[self.rigid :], self.rigid > 0, self.lumped
        return touching.doubt(self.model, self.equilibrium, *modes, self.quarter is not None)

    def matrices(self) -> "Matrices":
        """Return the stiffness and the mass of the pencil (`isorod.output.matrices.matrices`)."""
        from isorod.output.matrices import matrices

        return matrices(self.model, self.equilibrium, self.lumped)

    def derivatives(
        self,
        make: "Callable[[Mapping[str, float]], Model]",
        at: "Mapping[str, float]",
        measure: "Callable[[Modes], Mapping[str, object]]",
    ) -> "Derivatives":
        """Return the derivatives of what is measured by parameters (`isorod.modal.derivatives.derivatives`)."""
        from isorod.modal.derivatives import derivatives

        return derivatives(self, make, at, measure)

    def record(self) -> dict[str, Any]:
        """Return the entries of a record, and those of the equilibrium."""
        kept = ("about", "residuals", "rigid", "below", "shift", "iterations")
        record = {name: getattr(self, name) for name in kept}
        if self.falling:
            record["falling"] = self.falling
        return record if self.equilibrium is None else self.equilibrium.record() | record

    def frames(self) -> "list[tuple[float, Modes]]":
        """Return the states to show: these modes."""
        return [(0.0, self)]

    def curves(self) -> dict[str, Array]:
        """Return number, frequency and residual of each mode, a row a mode."""
        numbers = np.arange(1.0, len(self) + 1.0)
        return {"mode": numbers, "frequency": self.frequencies, "residual": self.residuals}

    def fields(self, body: int) -> dict[str, Array]:
        """Return a body's part of each mode shape, ``(nodes, 3)``, and the fields of the equilibrium, if any."""
        fields = {} if self.equilibrium is None else self.equilibrium.fields(body)
        later = () if self.quarter is None else self.quarter
        for name, vectors in (("mode", self.vectors), ("quarter", later)):
            fields |= {f"{name}_{k + 1}": self.model.nodal(vector, body) for k, vector in enumerate(vectors)}
        return fields

    def solid_fields(self, solid: int) -> dict[str, Array]:
        """Return a finite element body's part of each mode shape, ``(3 nodes,)``, and of the equilibrium, if any."""
        fields = {} if self.equilibrium is None else self.equilibrium.solid_fields(solid)
        return fields | {f"mode_{k + 1}": shape for k, shape in enumerate(self.solids[solid])}
