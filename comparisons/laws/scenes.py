"""The laws, and the rods on which they are compared: pulled, twisted, bent, wound, and with pressure inside."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from isorod.geometry.center_line import arc, helix, straight
from isorod.geometry.rod import Rod
from isorod.geometry.section import circle
from isorod.material import LinearElastic, NeoHookean
from isorod.material.fibre import helix as winding
from isorod.material.gent import Gent
from isorod.material.holzapfel_gasser_ogden import HolzapfelGasserOgden
from isorod.material.hyperelastic import Hyperelastic
from isorod.material.law import Material
from isorod.material.mooney_rivlin import MooneyRivlin
from isorod.material.muscle import Muscle
from isorod.material.ogden import Ogden
from isorod.material.st_venant_kirchhoff import StVenantKirchhoff
from isorod.material.yeoh import Yeoh
from isorod.model import Body, Model, Pressure, Support
from isorod.space import Space

# Shear moduli are about 1, and bulk moduli those of a Poisson's ratio of 0.4.
_NU = 0.4
_E, _BULK = 2.0 * (1.0 + _NU), 14.0 / 3.0

# isorod's space: of finer ones no number here differs by more than 3e-4.
_DEGREE, _ACROSS = 4, 8

# Where elements of the rods end besides, as shares of the axis from both ends: at held faces stress has no limit.
_TOWARDS = (0.03, 0.1, 0.25)


def _own() -> Material:
    """Return a law as a user writes it down, whose volumetric energy is none of those that laws have here."""
    from isorod.material.symbols import I1bar, J

    return Hyperelastic(0.5 * (I1bar - 3) + 0.02 * (I1bar - 3) ** 2 + _BULK / 4 * (J**2 - 1) ** 2 / 2)


LAWS: dict[str, Callable[[], Material]] = {
    "linear": lambda: LinearElastic(_E, _NU),
    "neo-hookean": lambda: NeoHookean(_E, _NU),
    "st-venant-kirchhoff": lambda: StVenantKirchhoff(_E, _NU),
    "muscle": lambda: Muscle(_E, _NU, 0.5, 0.3, 1.0, 1.0),
    "mooney-rivlin": lambda: MooneyRivlin(0.3, 0.2, _BULK),
    "yeoh": lambda: Yeoh(0.5, 0.05, 0.01, _BULK),
    "gent": lambda: Gent(1.0, 20.0, _BULK),
    "ogden": lambda: Ogden((1.3, -0.3), (1.7, -1.5), _BULK),
    "hgo": lambda: HolzapfelGasserOgden(1.0, 0.5, 0.8, _BULK),
    "hgo-two": lambda: HolzapfelGasserOgden(1.0, 0.5, 0.8, _BULK, 0.1, (winding(40.0), winding(-40.0))),
    "own": _own,
}


@dataclass(frozen=True)
class Scene:
    """A rod with its start held and its end moved and turned.

    Parameters
    ----------
    title
        What happens to it.
    rod
        Makes it.
    move, turn
        Displacement of its end [length] and rotation vector [rad].
    measured
        Names of what is compared, and where it is among `Scene.measure`'s.
    pressure
        Inside, follows the surface [force/area].
    """

    title: str
    rod: Callable[[], Rod]
    move: tuple[float, float, float]
    turn: tuple[float, float, float]
    measured: dict[str, Callable[[Any], float]]
    pressure: float = 0.0

    def model(self, law: Material) -> Model:
        """Return the model with a law."""
        space = Space(_graded(self.rod()), degree=_DEGREE, section_degree=_ACROSS)
        ends = Support.end(space, "start"), Support.end(space, "end", displacement=self.move, turn=self.turn)
        loads = [Pressure(self.pressure, "inner", follows=True)] if self.pressure else []
        return Model([Body(space, law, formulation="displacement")], ends, loads=loads)

    def measure(self, solution: Any) -> dict[str, float]:
        """Return what is compared of a solution, isorod's or finite elements'."""
        return {name: float(of(solution)) for name, of in self.measured.items()}


def _graded(rod: Rod) -> Rod:
    """Return a rod with elements that are short near its ends."""
    low, high = rod.axis.breaks[[0, -1]]
    for share in _TOWARDS:
        for u in (low + share * (high - low), high - share * (high - low)):
            if np.abs(rod.axis.breaks - u).min() > 0.01 * (high - low):
                rod = rod.insert(float(u))
    return rod


def _force(axis: int) -> Callable[[Any], float]:
    return lambda solution: float(solution.reactions[1, axis])


def _torque(solution: Any) -> float:
    return float(solution.moments[1, 2])


def _widening(solution: Any) -> float:
    return float(solution.at(0, 0.5, [1.0, 0.0])[0])


SCENES = {
    "cylinder": Scene(
        "cylinder pulled by a fifth and twisted by 1.5 rad",
        lambda: straight(6.0).sweep(circle(8)),
        (0.0, 0.0, 1.2),
        (0.0, 0.0, 1.5),
        {"force": _force(2), "torque": _torque},
    ),
    "arc": Scene(
        "quarter of a ring, its end moved out of the plane and turned",
        lambda: arc(4.0, 90.0).sweep(circle(8, 0.7)),
        (-0.5, 0.5, 1.0),
        (0.0, 0.0, 0.4),
        {"force out of the plane": _force(2)},
    ),
    "spring": Scene(
        "coil and a half, pulled",
        lambda: helix(3.0, 2.5, 1.5).sweep(circle(8, 0.7)),
        (0.0, 0.0, 2.0),
        (0.0, 0.0, 0.0),
        {"force": _force(2)},
    ),
    "tube": Scene(
        "tube pulled by a tenth, with pressure inside",
        lambda: straight(6.0).sweep(circle(8)).with_rings((0.6, 1.0)),
        (0.0, 0.0, 0.6),
        (0.0, 0.0, 0.0),
        {"widening": _widening, "force": _force(2)},
        0.15,
    ),
}
