"""The biceps: two branches of tendon, muscle, tendon that swell and press on each other (Lu & Zhou 2011, section 5)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, cast

import numpy as np

import isorod
from isorod.arrays import Array
from isorod.errors import InputError, positive, whole_number
from isorod.geometry import disk, section
from isorod.geometry.axis import Axis
from isorod.geometry.rod import Rod
from isorod.scenes import Preset, option, preset

# Elements of a branch as first built: tendon, three of muscle, tendon.
ELEMENTS = 5
# Control radius of the layers beside the middle one, relative to the radius of the belly: what makes it a spindle.
SHOULDER = 0.8
LENGTHS = "tendon_length", "belly_length", "belly_radius", "tendon_radius", "gap", "lower_distance", "upper_distance"
# Poisson's ratio from which pressures are chosen where there are fibres (`isorod.model.Body`).
NEARLY = 0.499
# Points round the section and in an element at which the surface is measured.
AROUND, ALONG = 64, 16


@dataclass(frozen=True)
class Biceps(Preset):
    """Two branches, tendon - muscle - tendon along y, ends held, whose active bellies swell and press on each other.

    No control point is printed in the paper.  Here every section is a circle normal to y, the branches mirror each
    other in the plane x = 0 and are symmetric in z; lengths are those of an adult's biceps, but for the tendons'
    thickness, which follows from their published stiffness: of 0.5 cm they would stretch by nearly half.  The lower
    ends overlap as in the paper, the bellies run along the plane x = 0, and the upper tendons leave it.

    Near incompressibility with clamped ends asks for short elements next to them (``end_elements``): the five equal
    elements of the paper cannot narrow near the ends and hold with 16 % too much force; cut once there, and the others
    in two, 2.4 % too much with ``order`` 1, 0.4 % with 2 (and, with ``end_elements`` 2, 0.7 % too little).  Nearer to
    0.5 displacements alone lock (6.6 % too much at ``nu`` 0.4999); with pressures they hold with 1.0 % too little
    there, and bulge by 3 % too little, but with twice as many ``elements`` and ``section_points`` 0.4 % and 0.6 % off,
    which is what is taken there (``python -m comparisons.nearly_incompressible biceps``).

    The time step is the paper's, six critical steps of the consistent mass: see `isorod.dynamics.explicit.mass`, which
    lets it be four to six times as long.
    """

    analyses: ClassVar[tuple[str, ...]] = ("dynamics", "statics")
    units: ClassVar[dict[str, str]] = {
        "end_force": "N (at lower and upper end of the one branch, then of the other)",
        "end_force_x": "N",
        "end_force_y": "N",
        "belly_bulge": "cm",
        "belly_bulge_history": "cm",
        "contact_force": "N",
        "contact_area": "cm^2",
        "penetration": "cm",
    }
    # Contact needs control points round the section.
    section_degree: ClassVar[None] = None

    tendon_length: float = option(4.0, "length along y of each of the two tendons of a branch [cm]")
    belly_length: float = option(12.0, "length along y of the muscle between them [cm]")
    belly_radius: float = option(1.6, "radius of a belly at its middle [cm]")
    tendon_radius: float = option(0.7, "radius of the tendons at the ends of a branch [cm]")
    gap: float = option(0.1, "gap between the bellies at rest [cm]")
    lower_distance: float = option(0.3, "distance of the centres of the lower ends, which overlap [cm]")
    upper_distance: float = option(4.0, "distance of the centres of the upper ends [cm]")
    E: float = option(30.0, "Young's modulus of the muscle's matrix [N/cm^2]")
    nu: float = option(0.49, "Poisson's ratio of muscle and tendon")
    sigma_max: float = option(30.0, "largest active fibre stress [N/cm^2]")
    m1: float = option(35.0, "factor of the passive fibre stress [N/cm^2]")
    m2: float = option(0.5, "exponent of the passive fibre stress")
    tendon_factor: float = option(10.0, "stiffness of the tendons relative to the muscle's matrix")
    fibre: str = option("y", "fibre direction: y (the paper's), or tangent, along the centre line of each branch")
    activation: float = option(1.0, "activation of the muscle in the end, 0 to 1")
    penalty: float = option(500.0, "contact pressure per depth of penetration [N/cm^3]")
    statics: bool = option(False, "find the equilibrium without following the motion")
    ramp: float = option(2.5e-3, "time in which the activation grows linearly [s] (paper: 100 steps)")
    time_step: float = option(
        4e-5, "longest time step [s] (paper: 2.5e-5); 0 for 0.9 of the critical one of the consistent mass"
    )
    end_time: float = option(0.25, "time to reach [s]")
    outputs: int = option(50, "number of equal intervals between outputs")
    damping: float = option(100.0, "mass-proportional damping [1/s]")
    density: float = option(1.06e-5, "mass per volume [N s^2/cm^4]")
    section_points: int | None = option(None, "control points round a branch (8, and 16 from nu = 0.499 on; paper: 8)")
    elements: int | None = option(
        None,
        "elements along a branch besides end_elements, a multiple of 5 (10, and 20 from nu = 0.499 on; paper: 5)",
    )
    end_elements: int | None = option(
        None, "cuts of the element next to each held end, shortest at the end (1; paper: 0)"
    )
    order: int | None = option(None, "polyharmonic order K of the section functions, 1 to 6 (2; paper: 1)")
    degree: int | None = option(None, "degree along the axis, 2 to 6 (2)")
    continuity: int | None = option(None, "continuity at inserted knots, 0 to degree - 1 (degree - 1)")
    formulation: str | None = option(
        None, "displacement, or mixed: displacement and pressure (mixed from nu = 0.499 on, but in explicit steps)"
    )
    quadrature: str | None = option(None, "quadrature rule: auto, full, paper, RxS or RxSxT such as 2x1x4 (auto)")
    preset: str | None = preset("order 1 (K = 1), degree 2, 5 elements a branch, quadrature auto")

    PAPER: ClassVar[Mapping[str, Any]] = {
        "section_points": 8,
        "order": 1,
        "degree": 2,
        "elements": 5,
        "end_elements": 0,
        "quadrature": "auto",
    }
    # Contact wants points round the section, and the smallest elements limit the time step.
    SUITS: ClassVar[Mapping[str, Any]] = {
        "section_points": 8,
        "order": 2,
        "degree": 2,
        "elements": 10,
        "end_elements": 1,
        "quadrature": "auto",
    }

    @property
    def suits(self) -> Mapping[str, Any]:
        """What is taken without a preset: pressures, chosen where muscle hardly changes its volume, ask for more."""
        finer = (
            {"section_points": 16, "elements": 20} if self.nu >= NEARLY and self.formulation != "displacement" else {}
        )
        return {**self.SUITS, **finer}

    @property
    def analysis(self) -> str:
        """The analysis that is asked for."""
        return "statics" if self.statics else "dynamics"

    def settings(self) -> dict[str, Any]:
        """Return the keyword arguments of `isorod.dynamics.solve`; of statics none."""
        if self.analysis == "statics":
            return {}
        if not (np.isfinite(self.time_step) and self.time_step >= 0.0):
            raise InputError(
                f"time step: got {self.time_step:g}, need a positive time, or 0 for 0.9 of the critical one"
            )
        return {
            "end_time": self.end_time,
            "time_step": self.time_step or None,
            "outputs": self.outputs,
            "damping": self.damping,
            "ramp": self.ramp,
        }

    def rods(self) -> tuple[Rod, Rod]:
        """Return the branches at ``x < 0`` and ``x > 0`` as first built: five quadratic elements, seven layers."""
        for name in LENGTHS:
            positive(name.replace("_", " "), getattr(self, name), "a positive length in cm")
        if self.tendon_radius > self.belly_radius:
            raise InputError(
                f"tendon radius: got {self.tendon_radius:g}, "
                f"need at most the radius of the belly, {self.belly_radius:g}"
            )
        right = self._centers()
        return self._branch(right * [-1.0, 1.0, 1.0]), self._branch(right)

    def _knots(self) -> Array:
        breaks = np.array([0.0, *np.linspace(0.0, self.belly_length, 4) + self.tendon_length, 0.0])
        breaks[-1] = breaks[-2] + self.tendon_length
        return np.concatenate([[0.0] * 2, breaks, [breaks[-1]] * 2])

    def _radii(self) -> Array:
        """Return the control radii: at the middle of the belly the radius is its radius."""
        thick, thin = self.belly_radius, self.tendon_radius
        middle = thick * (4.0 - SHOULDER) / 3.0
        return np.array([thin, thin, SHOULDER * thick, middle, SHOULDER * thick, thin, thin])

    def _end_knots(self) -> Array:
        """Return where the elements next to the held ends are cut: 1 : 2 : 4 ... from the end on."""
        count = whole_number("end elements", cast(int, self.end_elements), 0, 8)
        cuts = self.tendon_length * (2.0 ** np.arange(1, count + 1) - 1.0) / (2.0 ** (count + 1) - 1.0)
        return np.concatenate([cuts, 2.0 * self.tendon_length + self.belly_length - cuts])

    def _centers(self) -> Array:
        knots = self._knots()
        # Greville abscissae: the axis parameter is then the height y.
        y = 0.5 * (knots[1:-2] + knots[2:-1])
        x = self._radii() + 0.5 * self.gap
        x[0] = 0.5 * self.lower_distance
        x[-1] = 0.5 * self.upper_distance
        x[-2] = 0.5 * (x[-3] + x[-1])
        return np.stack([x, y, np.zeros_like(y)], axis=1)

    def _branch(self, centers: Array) -> Rod:
        axis = Axis(2, self._knots(), np.ones(ELEMENTS + 2))
        # Columns x, -z, y: the section's plane is normal to y, the tendons' line of action.
        turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        rotations = np.broadcast_to(turn, (axis.count, 3, 3))
        stretches = self._radii()[:, None, None] * np.eye(3)
        return Rod.sweep(section.circle(cast(int, self.section_points)), axis, centers, rotations, stretches)

    def model(self) -> "isorod.Model":
        """Return the model: tendons neo-Hookean, muscle with fibres, all ends held, bellies in contact.

        Bodies are the branches at ``x < 0`` and ``x > 0``; supports the lower and the upper end of the one, then of the
        other.
        """
        if self.fibre not in ("y", "tangent"):
            raise InputError(f"fibre: got {self.fibre!r}, need 'y' or 'tangent'")
        positive("tendon factor", self.tendon_factor, "a positive number")
        fibre = "tangent" if self.fibre == "tangent" else (0.0, 1.0, 0.0)
        elements = cast(int, self.elements)
        if elements < ELEMENTS or elements % ELEMENTS:
            raise InputError(f"elements: got {elements}, need a multiple of {ELEMENTS}")
        smooth = cast(int, self.degree) - 1 if self.continuity is None else self.continuity
        tendon = isorod.NeoHookean(self.tendon_factor * self.E, self.nu)
        muscle = isorod.Muscle(self.E, self.nu, self.sigma_max, self.m1, self.m2, self.activation, fibre)
        bodies, supports, bellies = [], [], []
        for branch, rod in enumerate(self.rods()):
            for u in self._end_knots():
                rod = rod.insert(u)
            space = self.space_of(rod, elements=elements // ELEMENTS * rod.axis.elements, continuity=smooth)
            middle = 0.5 * (space.axis.breaks[1:] + space.axis.breaks[:-1]) - self.tendon_length
            in_belly = (middle > 0.0) & (middle < self.belly_length)
            laws = [muscle if inside else tendon for inside in in_belly]
            bodies.append(isorod.Body(space, laws, self.density, self.formulation))
            supports += [isorod.Support.end(space, end, body=branch) for end in ("start", "end")]
            bellies.append(np.flatnonzero(in_belly).tolist())
        one, other = bellies
        contact = isorod.Contact(0, 1, self.penalty, one, other, points=(3, space.axis.degree + 1))
        return isorod.Model(bodies, supports, contacts=[contact])

    def measure(self, solution: "isorod.Equilibrium | isorod.History") -> dict[str, object]:
        """Return, at full load or at the last time, what holds the ends and how the bellies swell.

        ``end_force`` is the size of the support's force at each end [N], ``(4,)`` in the order of `model`'s supports,
        ``end_force_x`` and ``end_force_y`` its components (that along z vanishes by symmetry).  ``belly_bulge`` [cm] is
        half the growth of the extent in z of the muscle's lateral surface, tendons left out: of the greatest z less the
        smallest on it, now and at rest; the larger one of both branches.  Statics adds the total normal force of
        contact [N]; dynamics, whose records have that anyway, the ``belly_bulge_history`` at all outputs.
        """
        still = solution.displacement.ndim == 1
        forces = solution.reactions if still else solution.reactions[-1]
        bulges = self._bulges(solution.model, np.atleast_2d(solution.displacement))
        results: dict[str, object] = {
            "end_force": np.linalg.norm(forces, axis=1),
            "end_force_x": forces[:, 0],
            "end_force_y": forces[:, 1],
            "belly_bulge": float(bulges[-1]),
        }
        if not still:
            return results | {"belly_bulge_history": bulges}
        (contact,) = cast("isorod.Equilibrium", solution).contacts
        return results | {"contact_force": contact.force}

    def _bulges(self, model: "isorod.Model", displacements: Array) -> Array:
        """Return half the growth of the bellies' extent in z, the larger of both branches, shape ``(states,)``."""
        circle = disk.circle(AROUND)
        u = self.tendon_length + np.linspace(0.0, self.belly_length, (ELEMENTS - 2) * ALONG + 1)
        result = np.zeros((len(model.bodies), len(displacements)))
        for b, body in enumerate(model.bodies):
            rest = body.space.rod.grid(circle, u)[0][:, :, 2]
            for k, displacement in enumerate(displacements):
                z = rest + body.space.displacement(model.nodal(displacement, b), circle, u)[0][:, :, 2]
                result[b, k] = 0.5 * (np.ptp(z) - np.ptp(rest))
        return result.max(axis=0)
