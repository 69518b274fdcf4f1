"""An overhand knot in a rod that is straight at rest, drawn tight (Audoly, Clauvelin & Neukirch, PRL 99, 164301)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

import isorod
from isorod.arrays import Array
from isorod.errors import InputError, positive, within
from isorod.geometry import bspline, section
from isorod.geometry.center_line import straight
from isorod.geometry.fitting import nearest
from isorod.geometry.frames import Frames
from isorod.geometry.reading import chord_lengths
from isorod.geometry.rod import Rod
from isorod.scenes import Scene, option

POSITIVE = "radius", "tail", "E", "density", "settling", "time_step"

# The line that the rod is first laid along: half the length in which strands go round each other, over the root of
# both radii, and half their distance there, over the rod's radius.  They clear each other and bend little.
_BRAID, _APART = 3.8, 1.25

# Points of that line per radius of the rod.
_DENSE = 8

# Rate of damping, over the frequency of the loop's bending: with more, what is slow (how far strands have come round
# each other) is slower still, with less, what is fast takes as long as it.
_DAMPING = 0.6

# Longest loop and tail: of more radii the line has too many points.
_LONG = 1e5

# Points of that line for each element of the rod.
_POINTS = 8


@dataclass(frozen=True)
class Knot(Scene):
    """Rod without stress when straight, laid into a loose overhand knot, then left to settle between its held ends.

    How tight the knot is in the end is given by the length that is in it: ``2 pi`` times ``loop``, about.  A motion
    finds the equilibrium: it begins with a circle and two strands that go one and a half times round each other, moves
    in explicit steps, and damping takes the energy that bending has too much there.  Time is counted in that of the
    loop, ``loop^2 sqrt(density area / bending stiffness)``.

    Without friction ``N + M^2 / (2 B)`` is the same everywhere along a thin rod, with tension N, bending moment M and
    bending stiffness B: in the straight tails it is their tension, which the middle of the loop has to know.  As the
    rod gets thin beside the loop N vanishes there, and the tension is ``B / (2 loop_radius^2)``.
    """

    analysis: ClassVar[str] = "dynamics"
    units: ClassVar[dict[str, str]] = {
        "tension": "(unit of E x length^2; of the tails)",
        "tension_by_loop": "(the same, from tension and bending of the loop's middle, without friction)",
        "loop_radius": "(length; radius of the centre line's curvature in the middle of the loop)",
        "kinetic_share": "(energy of motion that is left, over the stored)",
    }

    radius: float = option(1.0, "radius of the rod [length]")
    loop: float = option(10.0, "radius of the loop as laid, over the rod's, at least 6")
    tail: float = option(25.0, "length of the straight ends as laid, over the rod's radius")
    E: float = option(1000.0, "Young's modulus [force/area]")
    nu: float = option(0.3, "Poisson's ratio")
    density: float = option(1.0, "mass per volume")
    friction: float = option(0.0, "coefficient of friction")
    settling: float = option(45.0, "time to settle, over that of the loop")
    time_step: float = option(
        0.5, "longest time step, over the time in which a wave goes the rod's radius (twice the critical one)"
    )
    outputs: int = option(12, "number of equal intervals between outputs")
    section_points: int = option(8, "control points round the rod, at least 3")
    elements: int = option(80, "elements along the rod")
    order: int = option(1, "polyharmonic order K of functions of the control points, 1 to 6")
    degree: int = option(3, "degree along the axis, 2 to 6")
    quadrature: str | None = option(None, "quadrature rule: auto, full, paper, RxS or RxSxT such as 2x1x4 (chosen)")

    @property
    def bending(self) -> float:
        """Bending stiffness [force x length^2]."""
        return 0.25 * np.pi * self.E * self.radius**4

    def settings(self) -> dict[str, Any]:
        """Return the keyword arguments of `isorod.dynamics.solve`."""
        # First, as it refuses what cannot be computed with.
        laid = self.laid.ravel()
        time = (self.loop * self.radius) ** 2 * np.sqrt(self.density * np.pi * self.radius**2 / self.bending)
        return {
            "end_time": self.settling * time,
            "time_step": self.time_step * self.radius * float(np.sqrt(self.density / self.E)),
            "outputs": self.outputs,
            "damping": _DAMPING / time,
            "displacement": laid,
        }

    @cached_property
    def line(self) -> Array:
        """Points of the centre line as laid, over the rod's radius, ``(m, 3)``: both tails along x.

        The loop is a circle that begins and ends where the tails do; there each strand is both a tail and a part of it.
        """
        for name in POSITIVE:
            positive(name.replace("_", " "), getattr(self, name), "a positive number")
        # Squares of squares of it are computed.
        within("radius", self.radius, 1e-50, 1e50)
        within("tail", self.tail, 0.0, _LONG)
        if not 6.0 <= self.loop <= _LONG:
            raise InputError(
                f"loop: got {self.loop:g}, need 6 rod radii and more, at most 1e5, for strands to clear each other"
            )
        half = _BRAID * float(np.sqrt(self.loop))
        s = np.linspace(-half, half, 2 * int(half * _DENSE) + 1)
        both = (
            np.where((s < 0.0)[:, None], _tail(s), self._circle(s)),
            np.where((s < 0.0)[:, None], self._circle(s), _tail(s)),
        )
        across = both[1] - both[0]
        part = s / half
        angle = 1.5 * np.pi * (1.0 + 1.5 * part - 0.5 * part**3)
        apart = np.sqrt((2.0 * _APART * (1.0 - part**2)) ** 2 + across[:, 1] ** 2)
        across[:, 1:] = apart[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        first, last = (0.5 * (both[0] + both[1] + side * across) for side in (-1.0, 1.0))
        whole = 2.0 * np.pi * self.loop - 2.0 * half
        rest = half + whole * np.arange(1, int(whole * _DENSE)) / int(whole * _DENSE)
        out = half + self.tail * np.arange(1, int(self.tail * _DENSE) + 1) / int(self.tail * _DENSE)
        return np.concatenate([_tail(-out[::-1]), first, self._circle(rest), last, _tail(out)])

    def _circle(self, s: Array) -> Array:
        angle = s / self.loop
        return self.loop * np.stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * s], axis=1)

    @cached_property
    def _lengths(self) -> Array:
        """Length of the line up to each of its points [length]."""
        return self.radius * chord_lengths(self.line)

    def rod(self) -> Rod:
        """Return the rod at rest, straight along x from where it begins when laid."""
        begin, length = self.radius * self.line[0], float(self._lengths[-1])
        line = straight(start=begin, end=(begin[0] + length, *begin[1:]))
        return line.sweep(section.circle(self.section_points, self.radius))

    @cached_property
    def space(self) -> "isorod.Space":
        """The rod's space."""
        return self.space_of(self.rod())

    @cached_property
    def laid(self) -> Array:
        """Displacement of the nodes that lays the rod along the line without twist, shape ``(nodes, 3)``."""
        space, lengths = self.space, self._lengths
        axis = space.axis
        fractions = np.linspace(0.0, 1.0, _POINTS * axis.elements + 1)
        u = axis.breaks[0] + np.ptp(axis.breaks) * fractions
        points = [np.interp(fractions * lengths[-1], lengths, self.radius * along) for along in self.line.T]
        centers = nearest(axis, u, np.stack(points, axis=1))
        across = Frames(axis, centers, np.array([0.0, 1.0, 0.0]))(bspline.greville(axis.knots, axis.degree))
        rest = space.positions.reshape(space.layers, -1, 3)
        arms = rest - rest[:, space.basis.is_control_point].mean(axis=1, keepdims=True)
        places = centers[:, None] + np.einsum("jad,jld->jla", across, arms[..., 1:])
        result: Array = np.where(space.basis.is_control_point[:, None], places - rest, 0.0).reshape(-1, 3)
        return result

    def model(self) -> "isorod.Model":
        """Return the model: neo-Hookean, both end faces held as laid."""
        body = isorod.Body(self.space, isorod.NeoHookean(self.E, self.nu), self.density, "displacement")
        layers = np.arange(self.space.nodes).reshape(self.space.layers, -1)
        supports = [isorod.Support(nodes, "xyz", self.laid[nodes]) for nodes in layers[[0, -1]]]
        return isorod.Model([body], supports, contacts=[isorod.Contact(0, friction=self.friction)])

    def measure(self, solution: "isorod.History") -> dict[str, object]:
        """Return what pulls the tails, and how the loop is bent, at the end."""
        last = solution[-1]
        breaks = self.space.axis.breaks
        middle = last.section_forces(0, 0.5 * (breaks[0] + breaks[-1]))
        moment = float(np.linalg.norm(middle.M[1:]))
        pulls = solution.reactions[-1, :, 0]
        return {
            "tension": 0.5 * float(pulls[1] - pulls[0]),
            "tension_by_loop": float(middle.N) + 0.5 * moment**2 / self.bending,
            "loop_radius": self.bending / moment,
            "kinetic_share": float(solution.kinetic[-1] / solution.stored[-1]),
        }


def _tail(s: Array) -> Array:
    return np.stack([s, 0.0 * s, 0.0 * s], axis=1)
