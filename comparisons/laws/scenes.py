"""The laws, and the rods on which they are compared: pulled, twisted, bent, wound, and with pressure inside."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from comparisons.laws.ends import Shape, Vector
from isorod import statics
from isorod.geometry.center_line import CenterLine, straight
from isorod.geometry.coils import arc, helix
from isorod.geometry.rod import Rod
from isorod.geometry.section import circle
from isorod.material import LinearElastic, NeoHookean
from isorod.material.active_muscle import ActiveMuscle
from isorod.material.fibre import Fibre
from isorod.material.fibre import helix as winding
from isorod.material.gent import Gent
from isorod.material.holzapfel_gasser_ogden import HolzapfelGasserOgden
from isorod.material.hyperelastic import Hyperelastic
from isorod.material.law import Material
from isorod.material.mooney_rivlin import MooneyRivlin
from isorod.material.muscle import Muscle
from isorod.material.ogden import Ogden
from isorod.material.orthotropic import Orthotropic, TransverselyIsotropic
from isorod.material.st_venant_kirchhoff import StVenantKirchhoff
from isorod.material.yeoh import Yeoh
from isorod.model import Body, Model, Pressure, Support
from isorod.space import Space
from meshes.annulus import annulus
from meshes.bricks import bricks
from meshes.mesh import Array, Mesh
from meshes.rods import named
from meshes.template import o_grid

# Shear moduli are about 1, and bulk moduli those of a Poisson's ratio of 0.4.
_NU = 0.4
_E, _BULK = 2.0 * (1.0 + _NU), 14.0 / 3.0

# What the names of laws begin with that need pressures.
INCOMPRESSIBLE = "incompressible-"

# Load steps of both programs.
STEPS = 2

# Laws that know small strains alone see so much of what happens to a rod: turned by more, they are strained.
SMALL = 1e-2

# How often ends are given the shape of the section amid the rod, and how far a free length is off at first.
ROUNDS = 5
_LONGER = 1e-3

# Radius of the arc at rest.
_RADIUS = 3.0

# Pitch of the spring at rest.
_PITCH = 2.0

# Radius of the corners of the squares amid the meshes of sections.
_CORE = 0.6

# Where a tube's wall begins, of its radius.
_HOLE = 0.6


# Tension of a muscle by its stretch, relative.
CURVE = ((0.5, 0.0), (0.75, 0.6), (0.95, 1.0), (1.05, 1.0), (1.6, 0.0))


def _inclined(angle: float) -> Fibre:
    """Return the direction in the plane of tangent and normal at an angle to the first, degrees."""
    turn = math.radians(angle)
    return lambda places: math.cos(turn) * places.tangent + math.sin(turn) * places.normal


def _own() -> Material:
    """Return a law as a user writes it down, whose volumetric energy is none of those that laws have here."""
    from isorod.material.symbols import I1bar, J

    return Hyperelastic(0.5 * (I1bar - 3) + 0.02 * (I1bar - 3) ** 2 + _BULK / 4 * (J**2 - 1) ** 2 / 2)


LAWS: dict[str, Callable[[], Material]] = {
    "linear": lambda: LinearElastic(_E, _NU),
    "neo-hookean": lambda: NeoHookean(_E, _NU),
    "st-venant-kirchhoff": lambda: StVenantKirchhoff(_E, _NU),
    "transversely-isotropic": lambda: TransverselyIsotropic(6.0, 2.5, 0.3, 0.35, 1.2, "normal"),
    "orthotropic": lambda: Orthotropic(
        (5.0, 3.0, 2.0), (0.3, 0.25, 0.35), (1.2, 1.0, 0.8), (_inclined(20.0), "binormal")
    ),
    "muscle": lambda: Muscle(_E, _NU, 0.5, 0.3, 1.0, 1.0),
    "active-muscle": lambda: ActiveMuscle(_E, _NU, 0.5, 0.3, 1.0, 1.0, curve=CURVE),
    "mooney-rivlin": lambda: MooneyRivlin(0.3, 0.2, _BULK),
    "yeoh": lambda: Yeoh(0.5, 0.05, 0.01, _BULK),
    "gent": lambda: Gent(1.0, 20.0, _BULK),
    "ogden": lambda: Ogden((1.3, -0.3), (1.7, -1.5), _BULK),
    "hgo": lambda: HolzapfelGasserOgden(1.0, 0.5, 0.8, _BULK),
    "hgo-two": lambda: HolzapfelGasserOgden(1.0, 0.5, 0.8, _BULK, 0.1, (_inclined(40.0), _inclined(-40.0))),
    "hgo-wound": lambda: HolzapfelGasserOgden(1.0, 0.5, 0.8, _BULK, 0.1, (winding(40.0), winding(-40.0))),
    "own": _own,
    "incompressible-mooney-rivlin": lambda: MooneyRivlin(0.3, 0.2, math.inf),
    "incompressible-ogden": lambda: Ogden((1.3, -0.3), (1.7, -1.5), math.inf),
    "incompressible-hgo": lambda: HolzapfelGasserOgden(1.0, 0.5, 0.8, math.inf),
}


def scenes_of(law: str) -> tuple[str, ...]:
    """Return the names of a law's scenes."""
    if law == "hgo-wound":
        # Directions that wind about the centre line have no limit there.
        return ("tube",)
    if law in ("muscle", "active-muscle"):
        # Without a force at its ends a muscle gets so short that it finds no equilibrium as an arc.
        return ("cylinder", "spring", "tube")
    if law in ("transversely-isotropic", "orthotropic", "hgo-two"):
        # Across the tube's wall these are not the same all round, which takes finer meshes than the others do.
        return ("cylinder", "arc", "spring")
    return ("cylinder", "arc") if law.startswith(INCOMPRESSIBLE) else tuple(SCENES)


@dataclass(frozen=True)
class Scene:
    """A rod with its start held and its end moved and turned, such that it is strained evenly all along.

    Parameters
    ----------
    title
        What happens to it.
    rod
        Makes it.
    space
        Elements, degree and section's degree of isorod's space: of finer ones no number here differs by more than 2e-4.
    layers
        Of finite elements along the rod on level 1: a multiple of the axis elements.
    motion
        Displacement of its end [length] and rotation vector [rad] by the fraction of the motion, and by how many times
        as long as at rest the centre line is of a scene whose length is free.
    measured
        Names of what is compared, and where it is among `Scene.measure`'s.
    pressure
        Inside, follows the surface [force/area].
    free
        Whether the centre line is as long as no force asks for: with one, a curved rod is not strained evenly.
    """

    title: str
    rod: Callable[[], Rod]
    space: tuple[int, int, int]
    layers: int
    motion: Callable[[float, float], tuple[Vector, Vector]]
    measured: dict[str, Callable[[Any], float]]
    pressure: float = 0.0
    free: bool = False

    def model(self, law: Material, formulation: str = "displacement") -> Model:
        """Return the model with a law.

        Its end sections have the shape that the section amid the rod takes on: were they held as they are, stress at
        their edges would grow without limit, and finite elements converge on no mesh as they do elsewhere.
        """
        fraction = SMALL if law.linear else 1.0
        loads = [Pressure(fraction * self.pressure, "inner", follows=True)] if self.pressure else []
        elements, degree, across = self.space
        space = Space(self.rod(), elements, degree, degree - 1, section_degree=across)
        move, turn = self.motion(fraction, 1.0)
        ends = Support.end(space, "start"), Support.end(space, "end", displacement=move, turn=turn)
        lengths, forces = [1.0], []
        for _ in range(ROUNDS):
            model = Model([Body(space, law, formulation=formulation)], ends, loads=loads)
            solution = statics.solve(model, load_steps=STEPS)
            if self.free:
                step = np.subtract(self.motion(fraction, lengths[-1] + _LONGER)[0], move)
                forces.append(float(solution.reactions[1] @ step))
                lengths.append(_without_force(lengths, forces))
            shape = Shape(solution)
            move, turn = self.motion(fraction, lengths[-1])
            ends = shape.at(space, "start"), shape.at(space, "end", move, turn)
        return Model([Body(space, law, formulation=formulation)], ends, loads=loads)

    def mesh(self, level: int) -> Mesh:
        """Return a mesh of bricks of 27 nodes: on each level as many times those of level 1, in all directions.

        How far the outline of a solid section is from a circle is most of their error, so there are fewer rings.
        """
        rod, around = self.rod(), 4 * level
        hollow = rod.rings[0] > 0.0
        template = annulus(around, rod.rings, (level,)) if hollow else o_grid(around, max(1, level // 2), core=_CORE)
        return named(bricks(rod, template, level * self.layers), "rod 0")

    def measure(self, solution: Any) -> dict[str, float]:
        """Return the compared quantities of a solution, isorod's or finite elements'."""
        return {name: float(of(solution)) for name, of in self.measured.items()}


def _without_force(lengths: list[float], forces: list[float]) -> float:
    """Return where the force is zero of which the last two values are on a line; another length after the first."""
    if len(forces) < 2:
        return lengths[-1] - math.copysign(_LONGER, forces[-1])
    slope = (forces[-1] - forces[-2]) / (lengths[-1] - lengths[-2])
    return lengths[-1] - forces[-1] / slope


def _force(axis: int) -> Callable[[Any], float]:
    return lambda solution: float(solution.reactions[1, axis])


def _moment(axis: int) -> Callable[[Any], float]:
    return lambda solution: float(solution.moments[1, axis])


def _widening(solution: Any) -> float:
    return float(solution.at(0, 0.5, [1.0, 0.0])[0])


def _coil(pitch: float) -> CenterLine:
    """Return half a coil of a helix that is as long as one of radius 2 and the pitch that the spring has at rest."""
    around = 2.0 * math.pi
    return helix(math.sqrt((2.0 * around) ** 2 + _PITCH**2 - pitch**2) / around, pitch, 0.5)


def _opened(fraction: float, length: float) -> tuple[Vector, Vector]:
    """Return displacement and turn of the end of the quarter of a ring that is turned by up to half its angle."""
    angle, radius = 0.5 * math.pi * (1.0 - 0.5 * fraction), length * _RADIUS / (1.0 - 0.5 * fraction)
    move = _RADIUS - radius + radius * math.cos(angle), radius * math.sin(angle) - _RADIUS, 0.0
    return move, (0.0, 0.0, angle - 0.5 * math.pi)


def _pulled(fraction: float, _: float) -> tuple[Vector, Vector]:
    """Return displacement and turn of the spring's end where it becomes the helix of another pitch."""
    pitch = (1.0 + 0.75 * fraction) * _PITCH
    (start, first), (end, last) = _ends(_coil(_PITCH))
    (begin, before), (stop, after) = _ends(_coil(pitch))
    # How the start of the other helix has to be turned to be that of the spring.
    turn = first * before.inv()
    move = start + turn.apply(stop - begin) - end
    x, y, z = (turn * after * last.inv()).as_rotvec()
    return (float(move[0]), float(move[1]), float(move[2])), (float(x), float(y), float(z))


def _ends(line: CenterLine) -> list[tuple[Array, Rotation]]:
    """Return position and frame of both ends of a helix."""
    rod = line.sweep(circle(8, 0.6))
    ends = []
    for u in rod.axis.breaks[[0, -1]]:
        position, jacobian = rod.grid([[0.0, 0.0]], [u])
        columns = jacobian[0, 0] / np.linalg.norm(jacobian[0, 0], axis=0)
        ends.append((position[0, 0], Rotation.from_matrix(columns)))
    return ends


SCENES = {
    "cylinder": Scene(
        "cylinder pulled by a fifth and twisted by 0.8 rad",
        lambda: straight(3.0).sweep(circle(8)),
        (2, 5, 6),
        1,
        lambda fraction, _: ((0.0, 0.0, 0.6 * fraction), (0.0, 0.0, 0.8 * fraction)),
        {"force": _force(2), "torque": _moment(2)},
    ),
    "arc": Scene(
        "quarter of a ring, bent open to half its angle by moments alone",
        lambda: arc(_RADIUS, 90.0).sweep(circle(8, 0.6)),
        (4, 5, 6),
        2,
        _opened,
        {"moment": _moment(2)},
        free=True,
    ),
    "spring": Scene(
        "half a coil of a spring, pulled",
        lambda: _coil(_PITCH).sweep(circle(8, 0.6)),
        (8, 5, 6),
        4,
        _pulled,
        {"force": _force(2)},
    ),
    "tube": Scene(
        "tube pulled by a tenth, with pressure inside",
        lambda: straight(3.0).sweep(circle(8)).with_rings((_HOLE, 1.0)),
        (4, 4, 5),
        1,
        lambda fraction, _: ((0.0, 0.0, 0.3 * fraction), (0.0, 0.0, 0.0)),
        {"widening": _widening, "force": _force(2)},
        0.15,
    ),
}
