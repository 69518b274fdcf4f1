"""A compression spring that is held pressed and whose force falls with time: relaxation by creep."""

from dataclasses import dataclass
from typing import Any, ClassVar

import isorod
from isorod.errors import positive
from isorod.scenes import Wound, option


@dataclass(frozen=True)
class Creep(Wound):
    """Round wire in coils, pressed together at once and held: its metal creeps, and the force falls.

    Both end faces are clamped; the strain grows by Norton's law, ``A q^n`` of von Mises' stress.
    """

    analysis: ClassVar[str] = "statics"
    units: ClassVar[dict[str, str]] = {
        "kept": "(share of the force at first)",
        "force": "(unit of E x length^2; in the end)",
        "times": "(of each load step)",
        "forces": "(there)",
    }
    load_steps: ClassVar[int] = 5

    A: float = option(5e-12, "rate of strain at stress 1 [1/time]")
    n: float = option(3.0, "exponent of the stress, at least 1")
    travel: float = option(20.0, "what the spring is shortened by [length]")
    end_time: float = option(10.0, "how long it is held [time]")

    def settings(self) -> dict[str, Any]:
        """Return the keyword arguments of the analysis."""
        return super().settings() | {"end_time": self.end_time}

    def model(self) -> "isorod.Model":
        """Return the model: both ends clamped, one pushed at time 0 and held."""
        positive("end time", self.end_time)
        law = isorod.Creep(self.E, self.nu, self.A, self.n)
        return self.pressed(law, self.travel, [[0.0, 1.0], [self.end_time, 1.0]])

    def measure(self, solution: "isorod.Equilibrium") -> dict[str, object]:
        """Return what is left of the force, and the force by time."""
        times, _, forces = self.load_history(solution)
        begin = int((times <= 0.0).sum()) - 1
        return {
            "kept": float(forces[-1] / forces[begin]),
            "force": float(forces[-1]),
            "times": times[begin:].tolist(),
            "forces": forces[begin:].tolist(),
        }
