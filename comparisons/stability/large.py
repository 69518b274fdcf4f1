"""Large deformation: roll-up, stretch, twist, buckling with the branch behind it, and snap-through."""

from collections.abc import Iterator
from functools import cache, partial
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from comparisons.stability.point import Sweep
from comparisons.stability.rods import arch
from isorod import statics
from isorod.arrays import Index
from isorod.geometry.center_line import straight
from isorod.geometry.rod import Rod
from isorod.geometry.section import circle, ellipse
from isorod.material import NeoHookean
from isorod.model import Body, Model, SectionLoad, Support
from isorod.space import Space
from isorod.statics import continuation

TITLE = "large deformation: roll-up, stretch, twist, buckling, snap-through"
COLUMNS = {
    "moment": "error of the moment",
    "steps": "load steps",
    "cuts": "cut",
    "newton": "Newton iterations",
    "limit": "limit load",
}

ROLL = Sweep("roll-up, times round", "circle of the elastica; moment EI 2 pi turns / L", 1e-3)
STRETCH = Sweep("stretch of a bar", "exact: homogeneous uniaxial stress, neo-Hookean, nu = 0.3; force", 1e-8)
TWIST = Sweep(
    "twist, turns over a length of 20 R",
    "Rivlin: pi mu tau R^4 / 2, mixed form, nu = 0.499999, centre line held straight; torque",
    1e-3,
)
EULER = Sweep("Euler's load, length over radius", "pi^2 EI / (4 L^2)", 5e-3)
LONG = 200.0
BRANCH = Sweep(
    "post-buckling branch, load over Euler's",
    f"elastica, elliptic integrals; L/r = {LONG:g}, part of the length",
    5e-3,
)

# A bar may be pressed to nothing and pulled as far as it likes: the study goes on to where it fails.
LAW = NeoHookean(1.0, 0.3)
SOFT = NeoHookean(3.0, 0.499999)
EI = 0.25 * np.pi
SPAN, RISE = 100.0, 5.0
CROWN = 1e-3 * EI


def run(level: str) -> Iterator[dict[str, Any]]:
    """Yield the points."""
    full = level != "quick"
    for length in (100.0, 1000.0):
        turns = (0.5, 1.0, 2.0, 3.0) if full else (1.0, 2.0) if length < 1000.0 else (1.0,)
        yield from ROLL.over(turns, _roll, length, series=f"L/r = {length:g}")
    stretches = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 2.0, 5.0, 10.0, 20.0, 50.0) if full else (0.1, 0.3, 2.0, 10.0)
    yield from STRETCH.over(stretches, _stretch)
    yield from TWIST.over((1, 2, 5, 10) if full else (2,), _twist)
    yield from EULER.over((10.0, 20.0, 50.0, 100.0, 200.0, 500.0) if full else (20.0, 50.0), _euler)
    yield from _branch(LONG)
    finest = (16, 5) if full else (8, 5)
    finer = f"the same with {finest[0]} elements of degree {finest[1]}; first limit load"
    arch = Sweep("snap-through of a shallow arch, elements", finer, 5e-3)
    yield from arch.over((2, 4, 8, 12) if full else (2, 4), _arch, *finest)


def _space(rod: Rod, elements: int, degree: int = 4) -> Space:
    """Return a space without locking."""
    return Space.paper(rod, elements, degree, continuity=0, section_degree=3, quadrature=f"{degree}x5x{degree}")


def _line(space: Space, last: int = 0) -> Index:
    """Return the nodes of the centre line but for the clamped start and, unless ``last`` is 1, the end."""
    return np.arange(1, space.layers - 1 + last) * space.layer_nodes


def _counts(solution: statics.Equilibrium) -> dict[str, Any]:
    return {"steps": solution.load_steps, "cuts": solution.cuts, "newton": solution.newton_iterations}


def _roll(turns: float, length: float) -> dict[str, Any]:
    space = _space(straight(length).sweep(circle(4)), max(8, round(8 * turns)))
    supports = [
        Support.end(space, "start"),
        Support(_line(space), "y"),
        Support.end(space, "end", "y", turn=(0.0, 2.0 * np.pi * turns, 0.0), tied="xz"),
    ]
    solution = statics.solve(Model([Body(space, NeoHookean(1.0, 0.0))], supports), round(16 * turns))
    k, s = 2.0 * np.pi * turns, np.linspace(0.1, 1.0, 10)
    exact = np.stack([(1.0 - np.cos(k * s)) / k, 0.0 * s, np.sin(k * s) / k - s], axis=1)
    shape = space.displacement(solution.model.nodal(solution.displacement), [[0.0, 0.0]], s)[0][:, 0] / length
    moment = float(solution.moments[2, 1] / (EI * k / length) - 1.0)
    return {"error": float(np.abs(shape - exact).max()), "moment": moment} | _counts(solution)


def _stretch(stretch: float) -> dict[str, Any]:
    rod = straight(10.0).sweep(ellipse(8, 1.0, 0.8))
    space = Space.paper(rod, elements=4, section_degree=2, quadrature="auto")
    across = brentq(lambda a: LAW.mu * (a * a - 1.0) + LAW.lame * np.log(a * a * stretch), 1e-6, 1e3)
    stress = LAW.mu * (stretch - 1.0 / stretch) + LAW.lame * np.log(across**2 * stretch) / stretch
    along = int(np.argmax(np.abs(space.positions[: space.layer_nodes, 0])))
    supports = [
        Support.end(space, "start", "z"),
        Support.end(space, "end", "z", (0.0, 0.0, 10.0 * (stretch - 1.0))),
        Support(np.array([0]), "xy"),
        Support(np.array([(space.layers - 1) * space.layer_nodes]), "xy"),
        Support(np.array([along]), "y"),
    ]
    solution = statics.solve(Model([Body(space, LAW)], supports))
    exact = stress * rod.volume() / 10.0
    return {"error": float(abs(solution.reactions[1, 2] / exact - 1.0))} | _counts(solution)


def _twist(turns: int) -> dict[str, Any]:
    space = Space.paper(straight(20.0).sweep(circle(4)), 8 * turns, 3, section_degree=3, quadrature="auto")
    supports = [
        Support.end(space, "start"),
        Support(_line(space), "xy"),
        Support.end(space, "end", turn=(0.0, 0.0, 2.0 * np.pi * turns)),
    ]
    solution = statics.solve(Model([Body(space, SOFT, formulation="mixed")], supports), 4 * turns)
    exact = 0.5 * np.pi * SOFT.mu * 2.0 * np.pi * turns / 20.0
    return {"error": float(abs(solution.moments[2, 2] / exact - 1.0))} | _counts(solution)


@cache
def _column(length: float) -> Model:
    """Return a clamped-free column in a plane; Euler's load is half of that at factor 1."""
    space = _space(straight(length).sweep(circle(4)), 8)
    force = 2.0 * np.pi**2 * EI / (4.0 * length**2)
    supports = [Support.end(space, "start"), Support(_line(space, 1), "y")]
    return Model(
        [Body(space, NeoHookean(1.0, 0.0))], supports, loads=[SectionLoad.end(space, "end", (0.0, 0.0, -force))]
    )


def _euler(length: float) -> dict[str, Any]:
    return {"error": abs(2.0 * continuation.critical(_column(length), 0.1).factor - 1.0)}


def _branch(length: float) -> Iterator[dict[str, Any]]:
    """Yield the points of the branch: larger error of the tip's deflection and height over length."""
    model = _column(length)
    space = model.bodies[0].space
    path = continuation.follow(model, 0.02, 60, start=continuation.critical(model, 0.1))
    tip = (space.layers - 1) * space.layer_nodes
    across, along = abs(path.at(tip, "x")) / length, 1.0 + path.at(tip, "z") / length
    for factor, w, z, negative in zip(2.0 * path.factors, across, along, path.negative, strict=True):
        if factor > 1.0 + 20.0 / length**2:
            m = brentq(lambda m, factor=factor: (2.0 / np.pi * ellipk(m)) ** 2 - factor, 1e-14, 1.0 - 1e-12)
            gaps = w - 2.0 * np.sqrt(m) / ellipk(m), z - (2.0 * ellipe(m) / ellipk(m) - 1.0)
            result = {"error": float(np.abs(gaps).max()), "negative": int(negative)}
            yield BRANCH.point(float(factor), partial(dict, result))


@cache
def _limit(elements: int, degree: int) -> float:
    """Return the first limit load of the arch."""
    space = _space(arch(SPAN, RISE), elements, degree)
    loads = [SectionLoad((0.0, 0.0, -CROWN), u=0.5)]
    model = Model([Body(space, LAW)], [Support.end(space, "start"), Support.end(space, "end")], loads=loads)
    path = continuation.follow(model, 0.1, 30, longest=0.4, bounds=(-5.0, 5.0))
    top = int(np.argmax(np.diff(path.factors) < 0.0))
    near = slice(top - 2, top + 3)
    w = np.array(
        [space.displacement(model.nodal(d), [[0.0, 0.0]], [0.5])[0][0, 0, 2] for d in path.displacements[near]]
    )
    quartic = np.polynomial.Polynomial.fit(w, path.factors[near], 4)
    places = quartic.deriv().roots()
    real = places[np.isreal(places)].real
    return float(quartic(real[np.argmin(np.abs(real - w[2]))]))


def _arch(elements: int, finest: int, degree: int) -> dict[str, Any]:
    limit = _limit(elements, 4)
    return {"error": abs(limit / _limit(finest, degree) - 1.0), "limit": limit}
