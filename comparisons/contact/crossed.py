"""``python -m comparisons.contact.crossed [--nu NU] [--formulation mixed|displacement] [--across N]``: Hertz.

Two crossing cylinders against Hertz, by default and refined.

Equal elastic cylinders whose axes cross at a right angle, R = 1, E = 1000, nu = 0.3 or what is asked for: pressed by a
force of 1, so that contact alone holds the upper one, and by their backs, which come nearer by Hertz' approach (of
0.012305 at nu = 0.3) and by a quarter of it.  Spaces are those that scenes from files end on
(`isorod.contact.patches`), for patches as large as Hertz has them, with so many control points across.  Radii are by
the area in contact and by the second moment of the pressure, which is a fifth of Hertz' radius squared; pressures are
force per reference area.

Hertz' approach is that of points of half spaces infinitely far from the patch.  Backs are two radii away, on cylinders:
what the bodies deform there besides is, far from the patch, linear in the force, whatever the patch.  So the approach
of backs is ``K F^(2/3) + C F`` with Hertz' ``K``, as long as the patch is small beside the radius, and two pushes give
both; compared is the force at Hertz' approach without ``C F``.
"""

import argparse
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from time import process_time

import numpy as np

from comparisons.contact import hertz
from isorod import circle, statics, straight
from isorod.arrays import Array, Index
from isorod.contact.result import ContactResult
from isorod.geometry.rod import Rod
from isorod.material import LinearElastic
from isorod.model import Body, Contact, Model, SectionLoad, Support
from isorod.model.body import FORMULATIONS
from isorod.space.closer import Patch, closer
from isorod.space.space import Space

RADIUS, E, FORCE, LENGTH = 1.0, 1000.0, 1.0, 4.0

# Control points across the patch: too few, as many as scenes from files take, and more.
ACROSS = (3.0, Contact.across, 6.0)

# From z to x.
_ACROSS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

# How far above its middle the back of a bar begins, in radii.
_BACK = 0.36


@dataclass(frozen=True)
class Cylinders:
    """The cylinders, with a Poisson's ratio, a formulation (chosen if None) and so many control points across."""

    nu: float
    formulation: str | None
    across: float

    def exact(self, force: float = FORCE) -> hertz.PointContact:
        """Return Hertz' solution of a force."""
        return hertz.crossed_cylinders(force, hertz.modulus(E, self.nu, E, self.nu), (RADIUS, RADIUS))

    def bars(self, force: float = FORCE) -> list[Space]:
        """Return spaces of a bar along z about the origin, and of one along x that touches it from above."""
        long = self.exact(force).long
        rod = straight(LENGTH).sweep(circle(8, RADIUS))
        points = rod.control_points - rod.control_points.mean(axis=(0, 1))
        low, high = Rod(rod.axis, points), Rod(rod.axis, points @ _ACROSS.T + [0.0, 2.0 * RADIUS, 0.0])
        angles = 2.0 * np.pi / 720 * np.arange(720)
        circle_ = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        bars = []
        for bar, sign in ((low, 1.0), (high, -1.0)):
            height = sign * bar.grid(circle_, [0.5])[0][0, :, 1]
            reach = 1.2 * long
            patch = Patch(0.5, float(angles[height.argmax()]), reach, reach / RADIUS, 2.0 * long / self.across)
            bars.append(closer(bar, [patch]))
        return bars

    def by_push(self, fraction: float = 1.0) -> Model:
        """Return bars whose backs come nearer by a fraction of Hertz' approach."""
        low, high = self.bars(FORCE * fraction**1.5)
        supports = [
            Support(_back(low, -1.0), "xyz"),
            Support(_back(high, 1.0), "xyz", (0.0, -fraction * self.exact().approach, 0.0), 1),
        ]
        return self._model(low, high, supports)

    def by_force(self) -> Model:
        """Return bars of which the upper one is pressed by forces at its ends, and guided there."""
        low, high = self.bars()
        supports = [Support(_back(low, -1.0), "xyz")]
        supports += [Support.end(high, end, "xz", body=1) for end in ("start", "end")]
        loads = [SectionLoad.end(high, end, (0.0, -0.5 * FORCE, 0.0), body=1) for end in ("start", "end")]
        return self._model(low, high, supports, loads)

    def lowered(self, model: Model) -> Array:
        """Return displacements ``(dofs,)`` by which the upper bar has come nearer by Hertz' approach."""
        displacement = np.zeros((model.dofs // 3, 3))
        model.nodal(displacement.reshape(-1), 1)[model.bodies[1].space.is_control_point, 1] = -self.exact().approach
        return displacement.reshape(-1)

    def _model(self, low: Space, high: Space, supports: Sequence[Support], loads: Sequence[SectionLoad] = ()) -> Model:
        bodies = [Body(one, LinearElastic(E, self.nu), formulation=self.formulation) for one in (low, high)]
        return Model(bodies, supports, contacts=[Contact(0, 1, across=self.across)], loads=loads)

    def errors(self, result: ContactResult) -> dict[str, float]:
        """Return relative errors of a contact against Hertz at its own force."""
        exact = self.exact(result.force)
        load = result.areas * result.pressure
        moments = load @ result.positions[:, [0, 2]] ** 2 / load.sum()
        return {
            "radius by area": float(np.sqrt(result.area / np.pi)) / exact.long - 1.0,
            "radius by pressure": float(np.sqrt(5.0 * moments.mean())) / exact.long - 1.0,
            "peak": result.peak / exact.peak - 1.0,
        }

    def hertzian(self, fractions: Sequence[float], forces: Sequence[float]) -> float:
        """Return the force at Hertz' approach, of two pushes by fractions of it, less the part linear in the force."""
        approach = self.exact().approach
        given, measured = np.array(fractions) * approach, np.array(forces)
        terms = np.stack([measured ** (2.0 / 3.0), measured], axis=1)
        return float((approach / np.linalg.solve(terms, given)[0]) ** 1.5)


def _back(space: Space, sign: float) -> Index:
    """Return the nodes of a bar's side that looks up, or down if ``sign`` is negative."""
    height = sign * space.positions[:, 1].reshape(space.layers, -1)[0]
    control_points = np.flatnonzero(space.basis.is_control_point)
    middle = sign * float(space.rod.grid([[0.0, 0.0]], [0.5])[0][0, 0, 1])
    chosen = control_points[height[control_points] > middle + _BACK * RADIUS]
    return np.asarray((np.arange(space.layers)[:, None] * space.layer_nodes + chosen).ravel())


def solve(model: Model, begin: Array | None = None) -> ContactResult:
    """Return the contact of an equilibrium, without warnings of the quantities compared here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (result,) = statics.solve(model, start=begin).contacts
    return result


def main(arguments: Sequence[str]) -> None:
    """Print the table, a line as soon as it is known."""
    parser = argparse.ArgumentParser(prog="comparisons.contact.crossed")
    parser.add_argument("--nu", type=float, default=0.3, help="Poisson's ratio")
    parser.add_argument("--formulation", choices=FORMULATIONS, help="that which goes with it if not given")
    parser.add_argument("--across", type=float, action="append", help="control points across a patch (3, 4 and 6)")
    given = parser.parse_args(arguments)
    for across in given.across or ACROSS:
        pair, pushes = Cylinders(given.nu, given.formulation, across), []
        pressed = pair.by_force()
        for name, model, begin in (
            ("push", pair.by_push(), None),
            ("a quarter of it", pair.by_push(0.25), None),
            ("force", pressed, pair.lowered(pressed)),
        ):
            start = process_time()
            result = solve(model, begin)
            differences = ", ".join(f"{what} {100.0 * error:+.1f} %" for what, error in pair.errors(result).items())
            print(
                f"{model.bodies[0].formulation}, {across:g} asked across, {name} ({result.cells_across:.2g} seen, "
                f"{model.dofs} degrees of freedom): force {result.force:.4f}, {differences}; "
                f"{process_time() - start:.0f} s",
                flush=True,
            )
            pushes.append(result.force)
        force = pair.hertzian((1.0, 0.25), pushes[:2])
        print(f"{across:g} asked across, both pushes: force at Hertz' approach {force:.4f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
