"""Thin, concave, eccentric and twisted sections, elements of very different lengths, to where the map folds and on."""

import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from comparisons.stability.point import Sweep
from comparisons.stability.rods import STIFFNESSES, condition, stiffness
from isorod import modal
from isorod.geometry import section
from isorod.geometry.center_line import straight
from isorod.geometry.coils import helix
from isorod.geometry.disk import harmonic_functions
from isorod.geometry.rod import Rod
from isorod.material import LinearElastic
from isorod.model import Body, Model, Support
from isorod.scenes.blade import Blade
from isorod.scenes.flower import Flower
from isorod.space import Space

TITLE = "thin and distorted sections, short elements"
COLUMNS = {
    "condition": "condition number",
    "scaled": "after diagonal scaling",
    "first": "first frequency",
    "rule": "auto against full rule",
    "jacobian": "smallest Jacobian",
    "fold": "folds at",
    "warned": "warning",
}

RATIOS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
ELEMENTS: dict[str, dict[str, Any]] = {
    "K = 1, n = 8": {"section_points": 8},
    "K = 1, n = 16": {"section_points": 16},
    "K = 2, n = 16": {"section_points": 16, "order": 2},
    "polynomials N = 2": {"section_degree": 2},
}
BLADES: dict[str, dict[str, Any]] = {
    "K = 2, p = 3, n = 32, 16 elements": {"section_points": 32, "order": 2, "degree": 3, "elements": 16},
    "polynomials N = 4, p = 4, 12 elements": {"section_degree": 4, "degree": 4, "elements": 12},
}
SHAPES = {"symmetric": True, "paper's": False}
FINE: dict[str, Any] = {"section_degree": 6, "degree": 5, "elements": 16}
THINNED = Sweep(
    "trailing edge thinner by",
    f"the same blade, polynomials N = {FINE['section_degree']}, p = {FINE['degree']}, 16 elements, full rule; ten "
    "modes",
    2e-2,
)
DEPTH = Sweep("petal depth of the flower", "area of the outline", 1e-3)
OFFSET = Sweep("section off the ring's centre line, inwards", "Pappus' volume of the torus", 1e-6)
TWIST = Sweep("twist over one element [degrees]", "exact volume of the twisted prism", 0.1)
LENGTHS = Sweep("ratio of element lengths", "exact (Saint-Venant), one element of three short", 1e-6)


def run(level: str) -> Iterator[dict[str, Any]]:
    """Yield the points."""
    quick = level == "quick"
    for kind, name in STIFFNESSES.items():
        ellipse = Sweep(f"ellipse 1 : x, {name}", "exact (Saint-Venant)", 1e-3)
        for series, element in ELEMENTS.items():
            yield from ellipse.over(RATIOS, _ellipse, element, kind, series=series)
    for name, symmetric in SHAPES.items():
        for series, element in list(BLADES.items())[1 if quick else 0 :]:
            ratios = (1.0, 10.0, 100.0) if quick else (1.0, 1.5, 2.0, 2.5, 3.0, 10.0, 30.0, 100.0, 1000.0)
            yield from THINNED.over(ratios, _blade, element, symmetric, series=f"{name}, {series}")
    yield from _flowers()
    yield from _rings()
    for series, (degree, parts) in {"quadratic": (2, 1), "cubic": (3, 1), "quadratic, twice as many": (2, 2)}.items():
        turns = (15.0, 30.0, 45.0, 90.0, 120.0, 180.0, 270.0, 360.0, 540.0)
        yield from TWIST.over(turns, _twisted, degree, parts, series=series)
    for kind in ("torsion", "weak"):
        yield from LENGTHS.over((1.0, 1e2, 1e4, 1e6, 1e8, 1e10), _short, kind, series=STIFFNESSES[kind])


def _ellipse(ratio: float, element: dict[str, Any], kind: str) -> dict[str, Any]:
    n = element.get("section_points", 8)
    space = Space.paper(straight(4.0).sweep(section.ellipse(n, 1.0, 1.0 / ratio)), **element)
    measured, exact, model = stiffness(space, kind, 1.0, 1.0 / ratio, 4.0)
    plain, scaled = condition(model)
    return {"error": abs(measured / exact - 1.0), "condition": plain, "scaled": scaled}


def _short(ratio: float, kind: str) -> dict[str, Any]:
    middle = 2.0 / ratio
    line = straight(breaks=[0.0, 2.0, 2.0 + middle, 4.0 + middle], degree=3)
    space = Space.paper(line.sweep(section.ellipse(8, 1.0, 0.5)), section_degree=2)
    measured, exact, model = stiffness(space, kind, 1.0, 0.5, 4.0 + middle)
    plain, scaled = condition(model)
    return {"error": abs(measured / exact - 1.0), "condition": plain, "scaled": scaled}


def thinned(ratio: float, symmetric: bool) -> np.ndarray:
    """Return the paper's airfoil with its last control points ``ratio`` times as near to the chord, ``(16, 2)``.

    As in the paper, the heights of a circle's control points are multiplied by factors that are linear in the point's
    number; at the trailing edge 0.05 is divided by the ratio.  Made symmetric, the section has the same thickness and
    is convex.
    """
    angle = 2.0 * np.pi * (np.arange(16) + 0.5) / 16
    front = (0.168, 0.168) if symmetric else (0.35625, -0.02)
    upper, lower = (np.linspace(one, 0.05 / ratio, 8) for one in front)
    factor = np.concatenate([upper, lower[::-1] if symmetric else lower])
    return np.stack([np.cos(angle), np.sin(angle) * factor], axis=1) / np.cos(np.pi / 16)


def _blade(ratio: float, element: dict[str, Any], symmetric: bool) -> dict[str, Any]:
    scene = Blade()
    original = scene.rod()
    # The scene's own sweep, of another section.
    factors = 1.0 + (scene.taper - 1.0) * np.array([0.0, 0.5, 1.0])
    angles = np.radians(scene.twist) * np.array([0.0, 0.5, 1.0])
    turns = np.array([[[np.cos(t), -np.sin(t), 0.0], [np.sin(t), np.cos(t), 0.0], [0.0, 0.0, 1.0]] for t in angles])
    heights = np.array([0.0, 0.5, 1.0])[:, None] * np.array([0.0, 0.0, scene.length])
    rod = Rod.sweep(thinned(ratio, symmetric), original.axis, heights, turns, factors[:, None, None] * np.eye(3))
    rod.check()

    def frequencies(element: dict[str, Any], quadrature: str) -> np.ndarray:
        space = Space.paper(rod, quadrature=quadrature, **element)
        body = Body(space, LinearElastic(scene.E, scene.nu), scene.density)
        return modal.solve(Model([body], [Support.end(space, "start")]), 10).frequencies

    measured, full, fine = frequencies(element, "auto"), frequencies(element, "full"), frequencies(FINE, "full")
    return {
        "error": float(np.max(np.abs(measured / fine - 1.0))),
        "rule": float(np.max(np.abs(measured / full - 1.0))),
        "first": float(measured[0]),
    }


def _outline_area(polygon: np.ndarray) -> float:
    """Return the area inside the outline of a control polygon, by Green's theorem on a fine polyline."""
    theta = 2.0 * np.pi * np.arange(20000) / 20000
    values, _ = harmonic_functions(polygon.shape[0], np.stack([np.cos(theta), np.sin(theta)], axis=1))
    x, y = (values @ polygon).T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _smallest(depth: float) -> float:
    """Return the smallest Jacobian of the flower's section on a grid 50 times as fine as `Rod.check`'s.

    On the circle, as it is there.
    """
    polygon = section.flower(16, 4, 1.0, depth)
    theta = 2.0 * np.pi * np.arange(6400) / 6400
    _, slopes = harmonic_functions(16, np.stack([np.cos(theta), np.sin(theta)], axis=1))
    a = np.einsum("qia,ib->qab", slopes, polygon)
    return float((a[:, 0, 0] * a[:, 1, 1] - a[:, 0, 1] * a[:, 1, 0]).min())


def _flowers() -> Iterator[dict[str, Any]]:
    fold = float(brentq(_smallest, 0.1, 0.9))

    def solve(depth: float) -> dict[str, Any]:
        rod = Flower(depth=depth).rod()
        smallest = rod.check()
        exact = 2.0 * _outline_area(section.flower(16, 4, 1.0, depth))
        if depth > fold:
            return {"error": 1.0, "jacobian": smallest}
        return {"error": abs(rod.volume() / exact - 1.0), "jacobian": smallest}

    near = (fold * (1.0 + gap) for gap in (-1e-2, -1e-3, 1e-3, 1e-2))
    yield from DEPTH.over((0.0, 0.1, 0.2, 0.3, *near, 0.6, 0.8, 0.95), solve, fold=fold)


def _rings() -> Iterator[dict[str, Any]]:
    radius, wire = 2.0, 0.5
    line = helix(radius, 0.0, 1, 4)

    def solve(offset: float) -> dict[str, Any]:
        outline = section.circle(8, wire) - np.array([offset, 0.0])
        rod = line.sweep(outline, closed=True)
        smallest = rod.check()
        if offset > radius - wire:
            return {"error": 1.0, "jacobian": smallest}
        exact = 2.0 * np.pi * (radius - offset) * np.pi * wire**2
        return {"error": abs(rod.volume() / exact - 1.0), "jacobian": smallest}

    yield from OFFSET.over((0.0, 0.5, 1.0, 1.4, 1.49, 1.499, 1.501, 1.51, 1.6, 2.0), solve, fold=radius - wire)


def _twisted(degrees: float, degree: int, parts: int) -> dict[str, Any]:
    # Layers turn in proportion to their height.
    line = straight(breaks=np.linspace(0.0, 4.0, parts + 1).tolist(), degree=degree)
    untwisted = line.sweep(section.ellipse(8, 1.0, 0.5))
    heights = untwisted.control_points[:, :, 2].mean(axis=1)
    angle = np.radians(degrees) * parts * heights / 4.0
    turns = np.zeros((angle.size, 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angle)
    turns[:, 1, 0], turns[:, 0, 1] = np.sin(angle), -np.sin(angle)
    turns[:, 2, 2] = 1.0
    rod = replace(untwisted, control_points=np.einsum("jab,jib->jia", turns, untwisted.control_points))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        smallest = rod.check()
    result = {"error": abs(rod.volume() / (np.pi * 0.5 * 4.0) - 1.0), "jacobian": smallest}
    return result | ({"warned": str(caught[0].message)} if caught else {})
