"""A compression spring pushed past yield, let go, and pushed again: presetting (Wahl, Mechanical Springs, 1963)."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

import isorod
from isorod.arrays import Array
from isorod.errors import InputError, positive
from isorod.scenes import Wound, option

# Points of the residual stress: places across the wire from the coil's inside to its outside, in its radii.
PLACES = np.linspace(-1.0, 1.0, 9)


@dataclass(frozen=True)
class Set(Wound):
    """Round wire in coils, pushed together past yield, let go, pushed again and let go: what is left of the travel.

    Both end faces are clamped and one is moved, back each time to where the wire would be free if it were a bar in
    torsion (`left`).  There the force is nearly none; the set is where unloading, extrapolated, would reach zero.
    """

    analysis: ClassVar[str] = "statics"
    units: ClassVar[dict[str, str]] = {
        "set": "(length; what is left of the travel, without force)",
        "force": "(unit of E x length^2; at full travel, the first time)",
        "second_force": "(the same, the second time)",
        "torsion_bar": "(length; the set of a straight bar in torsion)",
        "force_left": "(unit of E x length^2; in the end)",
        "travels": "(at each load step)",
        "forces": "(there)",
        "stress_left": "(unit of E; shear stress across the wire in the end, from the coil's inside to its outside)",
    }
    load_steps: ClassVar[int] = 4

    yield_stress: float = option(1212.4, "von Mises' stress at which the wire yields [force/area]")
    hardening: float = option(2100.0, "slope of the yield stress by plastic strain [force/area]")
    push: float = option(1.5, "travel over that at which a bar in torsion yields first, more than 1")

    @property
    def _hard(self) -> float:
        """Share of the shear modulus that is left where the wire flows."""
        return self.hardening / (3.0 * self.shear + self.hardening)

    @property
    def first_yield(self) -> float:
        """Travel at which a bar in torsion as long as the wire yields first [length]."""
        length = 2.0 * np.pi * self.coil_radius * self.coils
        return float(length * self.coil_radius * self.yield_stress / np.sqrt(3.0) / (self.shear * self.wire_radius))

    @property
    def travel(self) -> float:
        """How far the end is pushed [length]."""
        return self.push * self.first_yield

    @property
    def left(self) -> float:
        """Share of the travel that a bar in torsion keeps: of its torque all comes back elastically."""
        x, hard, core = self.push, self._hard, 1.0 / self.push
        torque = 0.5 * np.pi * x * core**4
        torque += 2.0 * np.pi * ((1.0 - hard) * (1.0 - core**3) / 3.0 + hard * x * (1.0 - core**4) / 4.0)
        return float(1.0 - 2.0 * torque / (np.pi * x))

    def settings(self) -> dict[str, Any]:
        """Return the keyword arguments of the analysis."""
        return super().settings() | {"end_time": 4.0}

    def model(self) -> "isorod.Model":
        """Return the model: plastic, start clamped, end pushed, let go, pushed and let go, each in a time of 1."""
        for name in ("yield_stress", "E"):
            positive(name.replace("_", " "), getattr(self, name))
        if not self.push > 1.0:
            raise InputError(f"push: got {self.push:g}, need more than 1: up to there nothing flows")
        table = [[0.0, self.yield_stress], [1.0, self.yield_stress + self.hardening]]
        law = isorod.Plastic(self.E, self.nu, table)
        history = [[0.0, 0.0], [1.0, 1.0], [2.0, self.left], [3.0, 1.0], [4.0, self.left]]
        return self.pressed(law, self.travel, history)

    def measure(self, solution: "isorod.Equilibrium") -> dict[str, object]:
        """Return the set, the forces over the load steps, and the residual stress across the wire."""
        times, fractions, forces = self.load_history(solution)
        # The last load step of unloading, extrapolated linearly to zero force.
        last = int(np.flatnonzero(np.isclose(times, 2.0))[0])
        slope = (fractions[last] - fractions[last - 1]) / (forces[last] - forces[last - 1])
        first, second = (forces[np.isclose(times, one)][0] for one in (1.0, 3.0))
        return {
            "set": float(self.travel * (fractions[last] - slope * forces[last])),
            "force": float(first),
            "second_force": float(second),
            "torsion_bar": self.left * self.travel,
            "force_left": float(forces[-1]),
            "travels": (self.travel * fractions).tolist(),
            "forces": forces.tolist(),
            "stress_left": self.across(solution).tolist(),
        }

    def across(self, solution: "isorod.Equilibrium") -> Array:
        """Return the shear stress across the wire in the middle, along the axis of the coils, about."""
        middle = 0.5 * float(solution.model.bodies[0].space.axis.breaks[-1])
        xi = np.column_stack([PLACES, 0.0 * PLACES])
        jacobian, F = solution.model.bodies[0].space.rod.grid(xi, [middle])[1][0], solution.deformation_gradient
        frame = F(0, middle, xi) @ jacobian
        tangent = frame[..., 2] / np.linalg.norm(frame[..., 2], axis=1, keepdims=True)
        up = np.cross(tangent, frame[..., 0])
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        return np.asarray(np.einsum("qa,qab,qb->q", tangent, solution.stress(0, middle, xi), up))
