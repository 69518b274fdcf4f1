"""Results of harmonic response: amplitude and phase of displacement, acceleration and stress at any point."""

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

# Rotation of sections by shapes in differences of stress, which is linear in shapes so small.
_SMALL = 1e-4

# Fraction of the energy at a frequency above which a mode counts; error of amplitudes above which there is a warning.
_SWINGS, _LARGE = 0.01, 0.005

# Fraction of the energy in one mode above which its stresses stand for those of the response.
_ALONE = 0.8


@dataclass(frozen=True, eq=False, repr=False)
class Ritz(State):
    """A shape, or a state plus a multiple of one, and its pressures."""

    def fields(self, body: int) -> dict[str, Array]:
        """Return a body's displacement ``(nodes, 3)``, and its pressure coefficients if it has some."""
        pressure = self.pressures[body] if len(self.pressures) else None
        return super().fields(body) | ({} if pressure is None else {"pressure": pressure})


@dataclass(frozen=True, eq=False, repr=False)
class Response:
    """A steady vibration ``Re(x exp(i omega t))`` at each of several frequencies, the first axis of all arrays.

    Displacements are relative to the base, accelerations are absolute; a phase ahead of the excitation is positive.

    Attributes
    ----------
    model
        The model without the oscillating loads.
    frequencies
        Cycles per time, shape ``(n,)``.
    coordinates
        Coefficients of the shapes, complex ``(n, m)``.
    ritz
        Modes and residual vectors, of unit mass.
    base
        Amplitude of the supports' acceleration, or displacement, shape ``(3,)``; zeros without base excitation.
    asked
        The frequencies as they were given.
    resonances, ratios
        Natural frequencies up to the highest, cycles per time, and the damping ratio of each.
    truncation
        Relative truncation error in the energy norm, the largest of both ends and resonances.
    modes
        The undamped modes, with some beyond the highest frequency.
    soft
        Prony series of viscoelastic bodies, by their number.
    about
        The state about which it is, as text.
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
        """Return the response at other frequencies, up to the highest that was asked for."""
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
        """Return the displacement at points of a body, relative to the base, complex ``(n, ..., 3)``."""
        each = np.array([one.at(body, u, xi) for one in self.ritz])
        return np.tensordot(self.coordinates, each, 1)

    def acceleration(self, body: Named, u: ArrayLike, xi: ArrayLike | None = None) -> Array:
        """Return the acceleration at points of a body, that of the base included, complex ``(n, ..., 3)``."""
        displacement = self.at(body, u, xi)
        across = (slice(None), *[None] * (displacement.ndim - 1))
        return self._shaken[across] * self.base - (self.omega**2)[across] * displacement

    @property
    def _shaken(self) -> Array:
        """Factors of ``base`` that give its acceleration, ``(n,)``."""
        return -self.basis.scale(self.omega) if self.basis.by_square else np.ones(len(self))

    def single(self, number: int) -> "Single":
        """Return the response at one of the frequencies."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        k = slice(number, number + 1)
        return Single(**values | {"frequencies": self.frequencies[k], "coordinates": self.coordinates[k]})

    def stress(self, body: Named, u: ArrayLike, xi: ArrayLike = (0.0, 0.0)) -> Array:
        """Return the Cauchy stress at points of a body without its static part, complex ``(n, ..., 3, 3)``."""
        moved = np.array([one.displacement for one in self.ritz])
        count, shapes = self.ritz[0].pressures, [*self.ritz]
        turned = self.coordinates
        if 2 * len(self) < len(shapes) and not any(one is not None for one in count):
            # Fewer evaluations: the response itself as shapes.
            vibration = self.coordinates @ moved
            shapes = [Ritz(self.model, part) for part in (*vibration.real, *vibration.imag)]
            turned = np.hstack([np.eye(len(self)), 1j * np.eye(len(self))])
        stress = np.tensordot(turned, self._stresses(shapes, body, u, xi), 1)
        series = self.soft.get(self.ritz[0]._number(body))
        if series is not None:
            # Shear moduli relax, and bulk moduli do not.
            missing = (series[:, 0] / (1.0 + 1j * self.omega[:, None] * series[:, 1])).sum(axis=1)
            shear = stress - np.trace(stress, axis1=-2, axis2=-1)[..., None, None] / 3.0 * np.eye(3)
            stress = stress - missing.reshape(-1, *[1] * (stress.ndim - 1)) * shear
        return np.asarray(stress)

    def signed(self, body: Named, u: Array, xi: Array, name: Component) -> Array:
        """Return a component of the stress at a grid of points, ``(n, t, q)``: complex, or the maximum of a period.

        The von Mises stress and the magnitude of the shear stress have no phase: their maximum is the longer half-axis
        of an ellipse, reached twice a period.
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
        """Return normals of sections in the state about which the response is, ``(t, q, 3)``."""
        _, jacobian = self.model.bodies[self.ritz[0]._number(body)].space.rod.grid(xi, u)
        moved = self.deformation_gradient(body, u, xi) @ jacobian
        return np.cross(moved[..., 0], moved[..., 1])

    def deformation_gradient(self, body: Named, u: ArrayLike, xi: ArrayLike = (0.0, 0.0)) -> Array:
        """Return the deformation gradient of the state about which it is, shape ``(..., 3, 3)``."""
        return self._state.deformation_gradient(body, u, xi)

    @cached_property
    def _state(self) -> State:
        equilibrium = self.modes.equilibrium
        return State(self.model, np.zeros(self.model.dofs), factor=0.0) if equilibrium is None else equilibrium

    def _stresses(self, shapes: Sequence[Ritz], body: Named, u: ArrayLike, xi: ArrayLike) -> Array:
        """Return the stress of each shape about the state, ``(m, ..., 3, 3)``, by a central difference."""
        state, radius = self._state, min(one.space.rod.radius for one in self.model.bodies)
        stresses = []
        for shape in shapes:
            step = _SMALL * radius / max(float(np.abs(shape.displacement).max()), 1e-300)
            ends = []
            for amplitude in (step, -step):
                pressures = [
                    None
                    if own is None
                    else amplitude * own + (0.0 if (there := _of(state.pressures, b)) is None else there)
                    for b, own in enumerate(shape.pressures)
                ]
                moved = state.displacement + amplitude * shape.displacement
                ends.append(Ritz(self.model, moved, factor=state.factor, pressures=pressures).stress(body, u, xi))
            stresses.append((ends[0] - ends[1]) / (2.0 * step))
        return np.array(stresses)

    def summary(self, measured: Mapping[str, Any]) -> dict[str, Any]:
        """Return the entries of a record for measures at each frequency (`isorod.output.swings.entries`)."""
        from isorod.output.swings import entries

        return entries(measured, self.frequencies, isinstance(self.asked, Span))

    def estimate(self, *directions: str) -> float | None:
        """Return an estimate of the relative error of the heights of peaks; None where there is none.

        It is twice that of the frequencies of the excited modes (`isorod.modal.Modes.estimate`), since compliances go
        by their squares, plus the truncation error.  On the flank of a peak, as narrow as its damping ratio, errors at
        a given frequency are larger; there is a warning.
        """
        error = self._of_frequencies(directions)
        if error is None:
            return None
        if not directions:
            self._warn_of_flanks(error)
        return 2.0 * error + (0.0 if directions else self.truncation)

    def _warn_of_flanks(self, error: float) -> None:
        """Warn if errors of natural frequencies are large beside the width of peaks."""
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
        """Return an estimate of the error of natural frequencies of the excited modes."""
        modes, rigid = self.modes, self.modes.rigid
        energies = np.abs(self.coordinates) ** 2 * np.abs(self.basis.squares)
        fractions = (energies / np.maximum(energies.sum(axis=1, keepdims=True), 1e-300)).max(axis=0)[: len(modes)]
        counted = (fractions > _SWINGS) & (modes.frequencies <= 1.01 * self.frequencies.max())
        # Below all resonances the first mode counts.
        counted[rigid] |= not counted[rigid:].any()
        span = slice(rigid, int(np.flatnonzero(counted)[-1]) + 1)
        given = modes.eigenvalues[span], modes.vectors[span], rigid > 0, modes.lumped, modes.equilibrium
        return of_modes(self.model, Spectrum(*given, counted=counted[span]), directions, self.ranks)

    def errors(self, *directions: str) -> Error:
        """Return `estimate`, and that of stresses: the worst of modes that are excited nearly alone."""
        modes, energies = self.modes, np.abs(self.coordinates) ** 2 * np.abs(self.basis.squares)
        largest = energies.argmax(axis=1)
        alone = energies.max(axis=1) > _ALONE * energies.sum(axis=1)
        single = np.unique(largest[alone & (largest < len(modes))])
        stress = None
        if modes.rigid == 0 and modes.equilibrium is None and single.size:
            stress = of_stress(self.model, modes.eigenvalues[single], modes.vectors[single], directions, self.ranks)
        return Error(self.estimate(*directions), stress)

    def record(self) -> dict[str, Any]:
        """Return the entries of a record without measures."""
        kept = ("about", "frequencies", "resonances", "ratios")
        left = {"share": self.truncation, "modes": len(self.modes), "shapes": len(self.ritz)}
        return {name: getattr(self, name) for name in kept} | {"left_out": left, "residuals": self.modes.residuals}

    def shapes(self) -> Iterator[tuple[float, Array]]:
        """Yield the modes with twice their energy, as `isorod.modal.Modes.shapes`."""
        return self.modes.shapes()

    def frames(self) -> "list[tuple[float, Deformation]]":
        """Return the states to show: none."""
        return []

    def curves(self) -> dict[str, Array]:
        """Return the frequencies, to which measures are added."""
        return {"frequency": self.frequencies}


class Single(Response):
    """A response at one frequency; its stresses have no axis of frequencies."""

    def stress(self, body: Named, u: ArrayLike, xi: ArrayLike = (0.0, 0.0)) -> Array:
        """Return Cauchy's stress at points of a body, complex ``(..., 3, 3)``."""
        return np.asarray(super().stress(body, u, xi)[0])


def refuse_principal(name: Component) -> None:
    """Raise `InputError` for a principal stress."""
    if name in ("max_principal", "min_principal"):
        raise InputError(f"component: {name} turns in a period, and has no amplitude; ask for von_mises or a component")


def _of(several: Sequence[Array | None], number: int) -> Array | None:
    return several[number] if len(several) else None
