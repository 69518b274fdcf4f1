"""Stiffness and density that jump along one rod, 1 to 1e8 and on to where double precision gives up."""

import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from scipy.optimize import brentq

from comparisons.stability.point import Sweep, petsc
from isorod import dynamics, modal, statics
from isorod.geometry.center_line import straight
from isorod.geometry.section import circle
from isorod.material import LinearElastic, NeoHookean
from isorod.model import Body, Model, Support
from isorod.space import Space

TITLE = "stiffness and density contrast in one rod"
COLUMNS = {
    "soft_end": "error at the soft end",
    "balance": "residual / first",
    "rigid_limit": "to the rigid limit",
    "newton": "Newton iterations",
    "residual": "eigenresidual",
    "warned": "warning",
    "steps": "time steps",
}

# A tendon of this length, then a muscle, radius 1 (stretching, bending) or 0.1 (modes).
JOINT, LENGTH = 4.0, 10.0
STRETCH, SIDEWAYS = 2.0, 3.0

SOLVERS: dict[str, dict[str, Any]] = {
    "banded LU (default)": {},
    "Cholesky, MUMPS": {"pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"},
    "CG + ICC": {"ksp_type": "cg", "pc_type": "icc", "ksp_max_it": 2000},
    "CG + GAMG": {"ksp_type": "cg", "pc_type": "gamg", "ksp_max_it": 2000},
}

BARS = "exact: bars in series, neo-Hookean, nu = 0"
STRETCHED = Sweep("stiffness contrast, stretched", BARS, 1e-6)
KNOT = Sweep("stiffness contrast, no knot at the joint", BARS, 1e-2)
BENT = Sweep("stiffness contrast, bent", "the same on twice the elements, degree 5, polynomials of degree 4", 1e-2)
MODES = Sweep(
    "contrast, longitudinal modes",
    "exact: longitudinal modes of a bar of two materials, nu = 0, fixed - free, first four",
    1e-6,
)
MOTION = {
    one: Sweep(
        f"contrast, a quarter of a longitudinal swing, {one} steps",
        "exact: period of the slowest longitudinal mode, nu = 0, fixed - free",
        1e-3,
    )
    for one in ("explicit", "implicit")
}


def run(level: str) -> Iterator[dict[str, Any]]:
    """Yield the points."""
    yield from at_rest(level)
    yield from swinging(level)


def _contrasts(level: str) -> list[float]:
    return [float(f"1e{k}") for k in range(0, 17, 2 if level == "quick" else 1)]


def at_rest(level: str) -> Iterator[dict[str, Any]]:
    """Yield the points of equilibria."""
    contrasts = _contrasts(level)
    for series, options in SOLVERS.items():
        iterative = "ksp_type" in options
        with petsc(options):
            chosen = contrasts[:5] if iterative and level == "quick" else contrasts
            yield from STRETCHED.over(chosen, _stretched, True, series=series)
    yield from KNOT.over((1.0, 3.0, 10.0, 30.0, 100.0, 1e4, 1e8), _smooth, series="C2 across the joint")
    chosen = contrasts[: 5 if level == "quick" else 13]
    yield from BENT.over(chosen, _bent, series="tendon clamped, muscle's end moved sideways")


def swinging(level: str) -> Iterator[dict[str, Any]]:
    """Yield the points of modes and motions."""
    contrasts = _contrasts(level)
    for series, direction in MODE_SERIES.items():
        yield from MODES.over(contrasts, _modes, *direction, series=series)
    for integrator, sweep in MOTION.items():
        for series, direction in MODE_SERIES.items():
            chosen = contrasts[:3:2] if level == "quick" else contrasts[:9]
            yield from sweep.over(chosen, _motion, integrator, *direction, series=series)


def _space(joint: bool, elements: int = 4, degree: int = 3, order: int | None = None) -> Space:
    line = straight(breaks=[0.0, JOINT, LENGTH], degree=degree, continuity=0 if joint else degree - 1)
    return Space.paper(line.sweep(circle(8)), elements=2 * elements, section_degree=order, quadrature="auto")


def _halves(space: Space, first: Any, second: Any) -> list[Any]:
    half = space.axis.elements // 2
    return [first] * half + [second] * half


def _stretched(contrast: float, joint: bool) -> dict[str, Any]:
    space = _space(joint)
    body = Body(space, _halves(space, NeoHookean(contrast, 0.0), NeoHookean(1.0, 0.0)))
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, STRETCH))
    solution = statics.solve(Model([body], ends))
    exact = np.pi * force_in_series(contrast, 1.0, JOINT, LENGTH - JOINT, STRETCH)
    stiff, soft = (float(abs(sign * solution.reactions[k, 2] / exact - 1.0)) for k, sign in ((0, -1.0), (1, 1.0)))
    return {
        "error": max(stiff, soft),
        "soft_end": soft,
        "balance": solution.residual_norms[-1] / solution.residual_norms[0],
        "newton": solution.newton_iterations,
    }


def _smooth(contrast: float) -> dict[str, Any]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = _stretched(contrast, False)
    return result | ({"warned": str(caught[0].message)} if caught else {})


def force_in_series(first: float, second: float, first_length: float, second_length: float, pull: float) -> float:
    """Return the stress in bars in series pulled by ``pull``.

    ``P = E/2 (stretch - 1/stretch)``, neo-Hookean with nu = 0.
    """

    def strain(stress: float) -> float:
        # stretch - 1 of stretch - 1/stretch = 2 half, without cancellation.
        half = stress
        return half + half * half / (1.0 + np.hypot(half, 1.0))

    def gap(stress: float) -> float:
        return first_length * strain(stress / first) + second_length * strain(stress / second) - pull

    return float(brentq(gap, 0.0, 10.0 * max(first, second), xtol=1e-300, rtol=1e-15))


def _bent(contrast: float) -> dict[str, Any]:
    def force(space: Space) -> tuple[float, int, float]:
        body = Body(space, _halves(space, NeoHookean(contrast, 0.3), NeoHookean(1.0, 0.3)))
        ends = Support.end(space, "start"), Support.end(space, "end", displacement=(SIDEWAYS, 0.0, 0.0))
        solution = statics.solve(Model([body], ends))
        return (
            float(solution.reactions[1, 0]),
            solution.newton_iterations,
            solution.residual_norms[-1] / solution.residual_norms[0],
        )

    coarse, newton, balance = force(_space(True, 4, 3, 3))
    fine, _, _ = force(_space(True, 8, 5, 4))
    # A tendon without end is a wall: the muscle alone on the same elements.
    alone = Space.paper(
        straight(LENGTH - JOINT, degree=3).sweep(circle(8)), elements=4, section_degree=3, quadrature="auto"
    )
    ends = Support.end(alone, "start"), Support.end(alone, "end", displacement=(SIDEWAYS, 0.0, 0.0))
    wall = float(statics.solve(Model([Body(alone, NeoHookean(1.0, 0.3))], ends)).reactions[1, 0])
    return {
        "error": abs(coarse / fine - 1.0),
        "rigid_limit": abs(coarse / wall - 1.0),
        "newton": newton,
        "balance": balance,
    }


# Implicit steps in a quarter of a period.
STEPS = 100

# Young's modulus and density of both halves as powers of the contrast.
MODE_SERIES = {
    "stiff half fixed": (1, 0, 0, 0),
    "stiff half free": (0, 0, 1, 0),
    "heavy half fixed": (0, 1, 0, 0),
    "heavy half free": (0, 0, 0, 1),
}


def _modes(contrast: float, *powers: int) -> dict[str, Any]:
    model, exact = _halved(contrast, powers, LinearElastic, 6, 16)
    solution = modal.solve(model, 4)
    return {
        "error": float(np.max(np.abs(solution.frequencies / exact - 1.0))),
        "residual": float(solution.residuals.max()),
    }


def _halved(
    contrast: float, powers: Sequence[int], law: Callable[[float, float], Any], degree: int, elements: int
) -> tuple[Model, np.ndarray]:
    """Return a thin bar that moves along its axis alone, one end held, and its four lowest frequencies."""
    first_E, first_density, second_E, second_density = (contrast**power for power in powers)
    rod = straight(breaks=[0.0, JOINT, LENGTH], degree=degree, continuity=0).sweep(circle(8, 0.1))
    space = Space.paper(rod, elements=elements, section_degree=1, quadrature="auto")
    laws = _halves(space, law(first_E, 0.0), law(second_E, 0.0))
    body = Body(space, laws, _halves(space, first_density, second_density))
    # Only along the axis: lateral motions of a bar with nu = 0 are modes too.
    supports = [Support(np.arange(space.nodes), "xy"), Support.end(space, "start", "z")]
    exact = longitudinal((first_E, second_E), (first_density, second_density), (JOINT, LENGTH - JOINT), 4)
    return Model([body], supports), exact


def _motion(contrast: float, integrator: str, *powers: int) -> dict[str, Any]:
    """Let the slowest mode go from its largest amplitude for a quarter of its period: then it passes zero."""
    model, exact = _halved(contrast, powers, NeoHookean, 2, 8)
    shape = modal.solve(model, 1).vectors[0]
    start = 1e-6 * shape / np.abs(shape).max()
    quarter = 0.25 / exact[0]
    step = quarter / STEPS if integrator == "implicit" else None
    motion = dynamics.solve(model, quarter, step, outputs=1, displacement=start, integrator=integrator)
    # cos(omega t) near omega t = pi / 2.
    reached = float(motion.displacement[-1] @ start / (start @ start))
    return {"error": abs(np.arccos(reached) / (0.5 * np.pi) - 1.0), "steps": motion.steps}


def longitudinal(
    E: tuple[float, float], density: tuple[float, float], lengths: tuple[float, float], count: int
) -> np.ndarray:
    """Return the lowest longitudinal frequencies of a bar of two materials, fixed at its start, free at its end.

    ``tan(k_1 L_1) tan(k_2 L_2) = Z_1 / Z_2`` with ``Z = sqrt(E rho)``, as the condition that the phase of the motion,
    which grows with the frequency, reaches odd multiples of a quarter turn at the free end.
    """
    ratio = np.sqrt(E[1] * density[1] / (E[0] * density[0]))
    first, second = (length * np.sqrt(rho / e) for length, rho, e in zip(lengths, density, E, strict=True))

    def phase(omega: float) -> float:
        p = omega * first
        refraction = np.arctan2((ratio - 1.0) * np.sin(p) * np.cos(p), np.cos(p) ** 2 + ratio * np.sin(p) ** 2)
        return p + refraction + omega * second

    roots = []
    for k in range(count):
        target = (k + 0.5) * np.pi
        high = 1e-12 / (first + second)
        while phase(high) < target:
            high *= 2.0
        roots.append(brentq(lambda omega, target=target: phase(omega) - target, 0.0, high, xtol=1e-300, rtol=1e-15))
    return np.array(roots) / (2.0 * np.pi)
