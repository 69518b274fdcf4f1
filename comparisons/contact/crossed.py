"""``python -m comparisons.contact.crossed``: two crossing cylinders against Hertz, by default and refined.

Equal elastic cylinders whose axes cross at a right angle, R = 1, E = 1000, nu = 0.3: pressed by a force of 1, so that
contact alone holds the upper one, and by their backs, which come nearer by Hertz' approach of 0.012305 and by a quarter
of it.  Spaces are those that scenes from files end on (`isorod.contact.patches`), for patches as large as Hertz has
them, with so many control points across.  Radii are by the area in contact and by the second moment of the pressure,
which is a fifth of Hertz' radius squared; pressures are force per reference area.

Hertz' approach is that of points of half spaces infinitely far from the patch.  Backs are two radii away, on cylinders:
what the bodies give way there besides is, far from the patch, linear in the force, whatever the patch.  So the approach
of backs is ``K F^(2/3) + C F`` with Hertz' ``K``, as long as the patch is small beside the radius, and two pushes tell
both; told is the force at an approach of 0.012305 without ``C F``.
"""

import warnings
from collections.abc import Sequence
from time import process_time

import numpy as np

from comparisons.contact import hertz
from isorod import circle, statics, straight
from isorod.arrays import Array, Index
from isorod.contact.result import ContactResult
from isorod.geometry.rod import Rod
from isorod.material import LinearElastic
from isorod.model import Body, Contact, Model, SectionLoad, Support
from isorod.space.closer import Patch, closer
from isorod.space.space import Space

RADIUS, E, NU, FORCE, LENGTH = 1.0, 1000.0, 0.3, 1.0, 4.0
EXACT = hertz.crossed_cylinders(FORCE, hertz.modulus(E, NU, E, NU), (RADIUS, RADIUS))

# Control points across the patch: too few, as many as scenes from files take, and more.
ACROSS = (3.0, Contact.across, 6.0)

# From z to x.
_ACROSS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

# How far above its middle the back of a bar begins, in radii.
_BACK = 0.36


def bars(across: float, force: float = FORCE) -> list[Space]:
    """Return spaces of a bar along z about the origin, and of one along x that touches it from above."""
    long = EXACT.long * (force / FORCE) ** (1.0 / 3.0)
    rod = straight(LENGTH).sweep(circle(8, RADIUS))
    points = rod.control_points - rod.control_points.mean(axis=(0, 1))
    low, high = Rod(rod.axis, points), Rod(rod.axis, points @ _ACROSS.T + [0.0, 2.0 * RADIUS, 0.0])
    angles = 2.0 * np.pi / 720 * np.arange(720)
    circle_ = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    found = []
    for one, sign in ((low, 1.0), (high, -1.0)):
        height = sign * one.grid(circle_, [0.5])[0][0, :, 1]
        reach = 1.2 * long
        patch = Patch(0.5, float(angles[height.argmax()]), reach, reach / RADIUS, 2.0 * long / across)
        found.append(closer(one, [patch]))
    return found


def _back(space: Space, sign: float) -> Index:
    """Return the nodes of a bar's side that looks up, or down if ``sign`` is negative."""
    height = sign * space.positions[:, 1].reshape(space.layers, -1)[0]
    carriers = np.flatnonzero(space.basis.is_carrier)
    middle = sign * float(space.rod.grid([[0.0, 0.0]], [0.5])[0][0, 0, 1])
    chosen = carriers[height[carriers] > middle + _BACK * RADIUS]
    return np.asarray((np.arange(space.layers)[:, None] * space.layer_nodes + chosen).ravel())


def by_push(across: float, share: float = 1.0) -> Model:
    """Return bars whose backs come nearer by a share of Hertz' approach."""
    low, high = bars(across, FORCE * share**1.5)
    supports = [
        Support(_back(low, -1.0), "xyz"),
        Support(_back(high, 1.0), "xyz", (0.0, -share * EXACT.approach, 0.0), 1),
    ]
    return _model(low, high, across, supports)


def by_force(across: float) -> Model:
    """Return bars of which the upper one is pressed by forces at its ends, and guided there."""
    low, high = bars(across)
    supports = [Support(_back(low, -1.0), "xyz")]
    supports += [Support.end(high, end, "xz", body=1) for end in ("start", "end")]
    loads = [SectionLoad.end(high, end, (0.0, -0.5 * FORCE, 0.0), body=1) for end in ("start", "end")]
    return _model(low, high, across, supports, loads)


def lowered(model: Model) -> Array:
    """Return displacements ``(dofs,)`` by which the upper bar has come nearer by Hertz' approach."""
    found = np.zeros((model.dofs // 3, 3))
    model.nodal(found.reshape(-1), 1)[model.bodies[1].space.is_carrier, 1] = -EXACT.approach
    return found.reshape(-1)


def _model(
    low: Space, high: Space, across: float, supports: Sequence[Support], loads: Sequence[SectionLoad] = ()
) -> Model:
    law = LinearElastic(E, NU)
    return Model([Body(low, law), Body(high, law)], supports, contacts=[Contact(0, 1, across=across)], loads=loads)


def errors(result: ContactResult) -> dict[str, float]:
    """Return relative errors of a contact against Hertz at its own force."""
    exact = hertz.crossed_cylinders(result.force, hertz.modulus(E, NU, E, NU), (RADIUS, RADIUS))
    load = result.areas * result.pressure
    moments = load @ result.positions[:, [0, 2]] ** 2 / load.sum()
    return {
        "radius by area": float(np.sqrt(result.area / np.pi)) / exact.long - 1.0,
        "radius by pressure": float(np.sqrt(5.0 * moments.mean())) / exact.long - 1.0,
        "peak": result.peak / exact.peak - 1.0,
    }


def hertzian(shares: Sequence[float], forces: Sequence[float]) -> float:
    """Return the force at Hertz' approach, of two pushes by shares of it, less what is linear in the force."""
    given, found = np.array(shares) * EXACT.approach, np.array(forces)
    return float((EXACT.approach / np.linalg.solve(np.stack([found ** (2.0 / 3.0), found], axis=1), given)[0]) ** 1.5)


def main() -> None:
    """Print the table, a line as soon as it is known."""
    for across in ACROSS:
        pushes = []
        pressed = by_force(across)
        for name, model, begin in (
            ("push", by_push(across), None),
            ("a quarter of it", by_push(across, 0.25), None),
            ("force", pressed, lowered(pressed)),
        ):
            start = process_time()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                solution = statics.solve(model, start=begin)
            (result,) = solution.contacts
            told = ", ".join(f"{what} {100.0 * error:+.1f} %" for what, error in errors(result).items())
            print(
                f"{across:g} wanted across, {name} ({result.cells_across:.2g} seen, {model.dofs} degrees of freedom): "
                f"force {result.force:.4f}, {told}; {process_time() - start:.0f} s",
                flush=True,
            )
            pushes.append(result.force)
        force = hertzian((1.0, 0.25), pushes[:2])
        print(f"{across:g} wanted across, both pushes: force at Hertz' approach {force:.4f}", flush=True)


if __name__ == "__main__":
    main()
