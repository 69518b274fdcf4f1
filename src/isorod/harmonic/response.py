"""What harmonic responses answer: amplitude and phase of displacement, acceleration and stress at any point."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.checks.estimate import Error
from isorod.checks.estimate_of_modes import Spectrum, of_modes, of_stress
from isorod.errors import InputError
from isorod.harmonic.frequencies import Span, checked
from isorod.modal.modes import Modes
from isorod.model.model import Model
from isorod.output.state import Deformation, Named, State
from isorod.output.stress import component
from isorod.output.words import Component

if TYPE_CHECKING:
    from isorod.harmonic.basis import Basis

# Shapes are added to a state so small that sections turn by about this much: stress is linear in it.
_SMALL = 1e-4

# Share of the energy at some frequency from which a mode counts, and the error from which amplitudes are warned of.
_SWINGS, _LARGE = 0.01, 0.005

# Share of the energy of one mode where its stresses are those of the response.
_ALONE = 0.8


@dataclass(frozen=True, eq=False, repr=False)
class Ritz(State):
    """A shape, or a state with a share of one, and its pressures."""

    def fields(self, body: int) -> dict[str, Array]:
        """Return a body's displacement ``(nodes, 3)``, and its pressure coefficients if it has some."""
        pressure = self.pressures[body] if len(self.pressures) else None
        return super().fields(body) | ({} if pressure is None else {"pressure": pressure})


@dataclass(frozen=True, eq=False, repr=False)
class Response:
    """A steady vibration ``Re(x exp(i omega t))`` at each of several frequencies; all arrays begin with these.

    Displacements are relative to what is shaken, accelerations are not; what is ahead of the excitation has a positive
    phase.

    Attributes
    ----------
    model
        What was solved, without the loads that swing.
    frequencies
        Cycles per time, shape ``(n,)``.
    coordinates
        Of the shapes, complex ``(n, m)``.
    ritz
        Modes and what residuals add to them, of unit mass.
    base
        Amplitude of the supports' acceleration, or displacement, shape ``(3,)``; zeros where loads swing.
    asked
        The frequencies as they were given.
    resonances, ratios
        Natural frequencies up to the highest, cycles per time, and the share of critical damping of each.
    truncation
        What the shapes leave out, relative, in the energy norm, the most at both ends and at resonances.
    modes
        The undamped modes, those beyond the highest frequency too.
    soft
        Prony series of viscoelastic bodies, by their number.
    about
        In words what it is about.
    seconds, built, solver, ranks
        As for `isorod.modal.Modes`.
    """

    model: Model
    frequencies: Array
    coordinates: Array
    ritz: Sequence[Ritz]
    base: Array
    asked: "Span | Array"
    resonances: Array
    ratios: Array
    truncation: float
    modes: Modes
    soft: Mapping[int, Array]
    basis: "Basis"
    seconds: dict[str, float]
    built: list[str]
    solver: dict[str, str]
    ranks: int
    about: str

    def __len__(self) -> int:
        return self.frequencies.size

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__} of {self.model!r}\n  about {self.about}\n  {len(self)} frequencies "
            f"{self.frequencies[0]:.6g} to {self.frequencies[-1]:.6g}, {self.resonances.size} resonances"
        )

    def over(self, frequencies: ArrayLike) -> "Response":
        """Return the same response at other frequencies, up to the highest that was asked for."""
        given = np.asarray(checked(frequencies))
        last = self.asked.last if isinstance(self.asked, Span) else self.asked.max()
        if given.max() > last * (1.0 + 1e-12):
            raise InputError(f"frequencies: got {given.max():g}, beyond {last:g}, to which there are modes")
        return replace(self, frequencies=given, coordinates=self.basis.coordinates(given))

    @property
    def omega(self) -> Array:
        """Angular frequencies, shape ``(n,)``."""
        return 2.0 * np.pi * self.frequencies

    def at(self, body: Named, u: ArrayLike, xi: ArrayLike | None = None) -> Array:
        """Return the displacement at points of a body, relative to what is shaken, complex ``(n, ..., 3)``."""
        each = np.array([one.at(body, u, xi) for one in self.ritz])
        return np.tensordot(self.coordinates, each, 1)

    def acceleration(self, body: Named, u: ArrayLike, xi: ArrayLike | None = None) -> Array:
        """Return the acceleration at points of a body, that of shaken supports included, complex ``(n, ..., 3)``."""
        found = self.at(body, u, xi)
        across = (slice(None), *[None] * (found.ndim - 1))
        return self._shaken[across] * self.base - (self.omega**2)[across] * found

    @property
    def _shaken(self) -> Array:
        """By what the amplitude of the base is its acceleration, ``(n,)``."""
        return -self.basis.scale(self.omega) if self.basis.by_square else np.ones(len(self))

    def single(self, number: int) -> "Single":
        """Return the response at one of the frequencies."""
        own = {one.name: getattr(self, one.name) for one in fields(self)}
        k = slice(number, number + 1)
        return Single(**own | {"frequencies": self.frequencies[k], "coordinates": self.coordinates[k]})

    def stress(self, body: Named, u: ArrayLike, xi: ArrayLike = (0.0, 0.0)) -> Array:
        """Return Cauchy's stress at points of a body, what is static left out, complex ``(n, ..., 3, 3)``."""
        moved = np.array([one.displacement for one in self.ritz])
        count, shapes = self.ritz[0].pressures, [*self.ritz]
        turned = self.coordinates
        if 2 * len(self) < len(shapes) and not any(one is not None for one in count):
            # Fewer shapes: those of the response itself.
            own = self.coordinates @ moved
            shapes = [Ritz(self.model, part) for part in (*own.real, *own.imag)]
            turned = np.hstack([np.eye(len(self)), 1j * np.eye(len(self))])
        found = np.tensordot(turned, self._stresses(shapes, body, u, xi), 1)
        series = self.soft.get(self.ritz[0]._number(body))
        if series is not None:
            # Shear moduli relax, and bulk moduli do not.
            missing = (series[:, 0] / (1.0 + 1j * self.omega[:, None] * series[:, 1])).sum(axis=1)
            shear = found - np.trace(found, axis1=-2, axis2=-1)[..., None, None] / 3.0 * np.eye(3)
            found = found - missing.reshape(-1, *[1] * (found.ndim - 1)) * shear
        return np.asarray(found)

    def signed(self, body: Named, u: Array, xi: Array, name: Component) -> Array:
        """Return a component of the stress at a grid of points, ``(n, t, q)``: complex, or the largest of a period.

        Von Mises' stress and the size of the shear stress have no phase: they are largest twice a period, and of an
        ellipse that is its longer half-axis.
        """
        normals = self._normals(body, u, xi) if name in ("along", "shear") else np.empty(0)
        stress = self.stress(body, u, xi)
        if name in ("von_mises", "shear"):
            return self.amplitude(stress, name, normals)
        refuse_principal(name)
        return component(stress, name, normals)

    def amplitude(self, stress: Array, name: Component, normals: Array) -> Array:
        """Return the largest value of a component in a period, of complex stresses ``(..., 3, 3)``, shape ``(...)``."""
        refuse_principal(name)
        if name not in ("von_mises", "shear"):
            return np.abs(component(stress, name, normals))
        parts = [component(one, name, normals) ** 2 for one in (stress.real, stress.imag, stress.real + stress.imag)]
        # Real part cos - imaginary part sin: the larger eigenvalue of their 2 x 2 products.
        a, b, c = parts[0], parts[1], 0.5 * (parts[2] - parts[0] - parts[1])
        return np.sqrt(0.5 * (a + b) + np.hypot(0.5 * (a - b), c))

    def _normals(self, body: Named, u: Array, xi: Array) -> Array:
        """Return normals of sections where they are in the state about which it is, ``(t, q, 3)``."""
        _, jacobian = self.model.bodies[self.ritz[0]._number(body)].space.rod.grid(xi, u)
        moved = self.deformation_gradient(body, u, xi) @ jacobian
        return np.cross(moved[..., 0], moved[..., 1])

    def deformation_gradient(self, body: Named, u: ArrayLike, xi: ArrayLike = (0.0, 0.0)) -> Array:
        """Return that of the state about which it is, shape ``(..., 3, 3)``."""
        return self._state.deformation_gradient(body, u, xi)

    @cached_property
    def _state(self) -> State:
        found = self.modes.equilibrium
        return State(self.model, np.zeros(self.model.dofs), factor=0.0) if found is None else found

    def _stresses(self, shapes: Sequence[Ritz], body: Named, u: ArrayLike, xi: ArrayLike) -> Array:
        """Return the stress of each shape about the state, ``(m, ..., 3, 3)``: a central difference."""
        state, radius = self._state, min(one.space.rod.radius for one in self.model.bodies)
        found = []
        for shape in shapes:
            step = _SMALL * radius / max(float(np.abs(shape.displacement).max()), 1e-300)
            ends = []
            for way in (step, -step):
                pressures = [
                    None if own is None else way * own + (0.0 if (there := _of(state.pressures, b)) is None else there)
                    for b, own in enumerate(shape.pressures)
                ]
                moved = state.displacement + way * shape.displacement
                ends.append(Ritz(self.model, moved, factor=state.factor, pressures=pressures).stress(body, u, xi))
            found.append((ends[0] - ends[1]) / (2.0 * step))
        return np.array(found)

    def told(self, found: Mapping[str, Any]) -> dict[str, Any]:
        """Return what a record keeps of what is measured at each frequency (`isorod.output.swings.entries`)."""
        from isorod.output.swings import entries

        return entries(found, self.frequencies, isinstance(self.asked, Span))

    def estimate(self, *directions: str) -> float | None:
        """Return an estimate of the relative error of the heights of peaks; None where there is none.

        It is twice that of the frequencies of the modes that swing (`isorod.modal.Modes.estimate`), by whose squares
        compliances go, and what the shapes leave out.  On the flank of a peak, half as wide as the share of critical
        damping, amplitudes at a given frequency err more; of that there is a warning.
        """
        found = self._of_frequencies(directions)
        if found is None:
            return None
        if not directions:
            self._warn_of_flanks(found)
        return 2.0 * found + (0.0 if directions else self.truncation)

    def _warn_of_flanks(self, error: float) -> None:
        """Warn where natural frequencies are off by much of the width of peaks."""
        damped = self.ratios[self.ratios > 0.0]
        flank = 0.5 * error / damped.min() if damped.size else 0.0
        if flank > max(_LARGE, 2.0 * error):
            warnings.warn(
                f"natural frequencies are right to about {100.0 * error:.2g} %, beside half-widths of peaks from "
                f"{100.0 * damped.min():.2g} %: on a flank the amplitude at a given frequency may be off by "
                f"{100.0 * flank:.2g} %, heights of peaks are not; --tolerance "
                f"{_LARGE * 4.0 * damped.min():.1g} is right there too",
                stacklevel=4,
            )

    def _of_frequencies(self, directions: Sequence[str]) -> float | None:
        """Return an estimate of the error of natural frequencies of the modes that swing."""
        modes, rigid = self.modes, self.modes.rigid
        energies = np.abs(self.coordinates) ** 2 * np.abs(self.basis.squares)
        shares = (energies / np.maximum(energies.sum(axis=1, keepdims=True), 1e-300)).max(axis=0)[: len(modes)]
        counted = (shares > _SWINGS) & (modes.frequencies <= 1.01 * self.frequencies.max())
        # Below all resonances it is that of the first.
        counted[rigid] |= not counted[rigid:].any()
        own = slice(rigid, int(np.flatnonzero(counted)[-1]) + 1)
        given = modes.eigenvalues[own], modes.vectors[own], rigid > 0, modes.lumped, modes.equilibrium
        return of_modes(self.model, Spectrum(*given, counted=counted[own]), directions, self.ranks)

    def errors(self, *directions: str) -> Error:
        """Return that, and an estimate of the error of stresses: of the worst of the modes that swing nearly alone."""
        modes, energies = self.modes, np.abs(self.coordinates) ** 2 * np.abs(self.basis.squares)
        largest = energies.argmax(axis=1)
        alone = energies.max(axis=1) > _ALONE * energies.sum(axis=1)
        own = np.unique(largest[alone & (largest < len(modes))])
        stress = None
        if modes.rigid == 0 and modes.equilibrium is None and own.size:
            stress = of_stress(self.model, modes.eigenvalues[own], modes.vectors[own], directions, self.ranks)
        return Error(self.estimate(*directions), stress)

    def record(self) -> dict[str, Any]:
        """Return what a record keeps of it, besides what is measured."""
        kept = ("about", "frequencies", "resonances", "ratios")
        left = {"share": self.truncation, "modes": len(self.modes), "shapes": len(self.ritz)}
        return {name: getattr(self, name) for name in kept} | {"left_out": left, "residuals": self.modes.residuals}

    def shapes(self) -> Iterator[tuple[float, Array]]:
        """Yield the modes with twice their energy, as `isorod.modal.Modes.shapes`."""
        return self.modes.shapes()

    def frames(self) -> "list[tuple[float, Deformation]]":
        """Return the states there are to show: none."""
        return []

    def curves(self) -> dict[str, Array]:
        """Return the frequencies, to which what is measured is added."""
        return {"frequency": self.frequencies}


class Single(Response):
    """A response at one frequency, whose stresses have no axis of frequencies."""

    def stress(self, body: Named, u: ArrayLike, xi: ArrayLike = (0.0, 0.0)) -> Array:
        """Return Cauchy's stress at points of a body, complex ``(..., 3, 3)``."""
        return np.asarray(super().stress(body, u, xi)[0])


def refuse_principal(name: Component) -> None:
    """Raise `InputError` for a principal stress."""
    if name in ("max_principal", "min_principal"):
        raise InputError(f"component: {name} turns in a period, and has no amplitude; ask for von_mises or a component")


def _of(several: Sequence[Array | None], number: int) -> Array | None:
    return several[number] if len(several) else None
