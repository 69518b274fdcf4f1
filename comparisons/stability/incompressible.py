"""Towards incompressibility at a fixed shear modulus.

The spring, a bent cantilever, a pinched section, and Rivlin's twisted cylinder.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.interpolate import BSpline

from comparisons.stability.point import Sweep
from isorod import statics
from isorod.geometry.center_line import straight
from isorod.geometry.section import circle
from isorod.material import NeoHookean
from isorod.model import Body, Model, SectionLoad, Support
from isorod.scenes.spring import Spring
from isorod.space import Space
from meshes.mesh import Array

TITLE = "near incompressibility"
COLUMNS = {
    "nu": "Poisson's ratio",
    "result": "result",
    "target": "reference",
    "unknowns": "unknowns",
    "newton": "Newton iterations",
}

RATIOS = (0.3, 0.49, 0.499, 0.4999, 0.49999, 0.499999)
TOLERANCE = 5e-3

SPRING = "1/2 - nu, force of the spring"
BENT = "1/2 - nu, deflection of a bent cantilever"
PINCHED = "1/2 - nu, work to pinch a section"
TWISTED = Sweep("twist of Rivlin's cylinder, nu = 0.499999 [rad]", "Rivlin, exact", 1e-4)

# Dead force sideways on the end of a bar of radius 1 and shear modulus 1: a third of its length.
LENGTH, FORCE = 10.0, 0.03
# Knots where the clamp's singularity wants them.
KNOTS = (0.0, 0.15, 0.4, 0.8, 1.4, 2.2, 3.4, 5.0, 7.0, LENGTH)
# A bar with both ends clamped, its surface moved in y by -SQUEEZE b(z) y, the bump b = 16 s^2 (1 - s)^2, s = z /
# HEIGHT.
HEIGHT, SQUEEZE = 4.0, 0.3

# Taylor-Hood solutions (`reference`), by Poisson's ratio in the order of RATIOS.
REFERENCE: dict[str, tuple[float, ...]] = {
    SPRING: (6.099903, 6.118388, 6.119255, 6.119341, 6.119350, 6.119351),
    BENT: (4.119438, 3.668597, 3.647631, 3.645535, 3.645325, 3.645304),
    PINCHED: (1.594733, 2.411704, 2.483675, 2.491239, 2.491999, 2.492076),
}
# Mesh of each: cells round the section, rings, layers.
MESHES = {SPRING: (12, 1, 72), BENT: (16, 2, 24), PINCHED: (16, 2, 24)}


def law(nu: float, mu: float = 1.0) -> NeoHookean:
    """Return the material of a shear modulus."""
    return NeoHookean(2.0 * mu * (1.0 + nu), nu)


def bump(z: Array) -> Array:
    """Return the bump of the pinched section."""
    s = z / HEIGHT
    return 16.0 * s**2 * (1.0 - s) ** 2


def spring(nu: float, formulation: str, **section: Any) -> tuple[float, statics.Equilibrium]:
    """Return the force of the spring of the scene, its shear modulus that of nu = 0.3."""
    young = Spring.E / 1.3 * (1.0 + nu)
    solution = statics.solve(Spring(preset="paper", E=young, nu=nu, formulation=formulation, **section).model())
    return float(solution.reactions[1, 2]), solution


def bent(nu: float, formulation: str, **section: Any) -> tuple[float, statics.Equilibrium]:
    """Return the deflection of a cantilever."""
    space = Space.paper(straight(breaks=KNOTS, degree=3).sweep(circle(8)), quadrature="auto", **section)
    load = SectionLoad.end(space, "end", (0.0, FORCE, 0.0))
    body = Body(space, law(nu), formulation=formulation)
    solution = statics.solve(Model([body], [Support.end(space, "start")], loads=[load]))
    return float(load.nodal(space).ravel() @ solution.displacement) / FORCE, solution


def pinched(nu: float, formulation: str, **section: Any) -> tuple[float, statics.Equilibrium]:
    """Return the work of the forces that pinch a section on their displacements."""
    rod = straight(breaks=(0.0, HEIGHT)).sweep(circle(8))
    space = Space.paper(rod, elements=6, degree=4, quadrature="auto", **section)
    axis = space.axis
    heights = np.array([axis.knots[j + 1 : j + axis.degree + 1].mean() for j in range(axis.count)])
    # The bump is a polynomial of the axis' degree: interpolation is exact.
    values = np.linalg.solve(BSpline.design_matrix(heights, axis.knots, axis.degree).toarray(), bump(heights))
    supports = [Support.end(space, "start"), Support.end(space, "end")]
    moves = []
    for j in range(1, axis.count - 1):
        for node in j * space.layer_nodes + np.arange(space.points_around):
            moves.append(-SQUEEZE * values[j] * space.positions[node, 1])
            supports.append(Support(np.array([node]), "y", (0.0, moves[-1], 0.0)))
    solution = statics.solve(Model([Body(space, law(nu), formulation=formulation)], supports))
    return float(solution.reactions[2:, 1] @ np.array(moves)), solution


def reference(case: str, nu: float, around: int, rings: int, layers: int) -> float:
    """Return the result of a case with Taylor-Hood bricks in dolfinx: displacement at 27 nodes, pressure at 8."""
    from comparisons.fem import mixed
    from comparisons.fem.domain import Domain
    from comparisons.fem.statics import Held
    from meshes.bricks import bricks
    from meshes.template import o_grid

    template = o_grid(around, rings, 2)
    if case == SPRING:
        domain = Domain.distribute(bricks(Spring(helix="paper").rod(), template, layers))
        held = [Held("start"), Held("end", (0.0, 0.0, Spring.travel))]
        return float(mixed.solve(domain, law(nu, Spring.E / 2.6), held).reactions[1, 2])
    if case == BENT:
        domain = Domain.distribute(bricks(straight(LENGTH).sweep(circle(8)), template, layers, grading=2.0))
        solution = mixed.solve(domain, law(nu), [Held("start")], {"end": (0.0, FORCE, 0.0)}, steps=2)
        return float(solution.deflections["end"][1])
    domain = Domain.distribute(bricks(straight(HEIGHT).sweep(circle(8)), template, layers))
    squeezed = mixed.Guided("lateral", 1, lambda x: -SQUEEZE * bump(x[2]) * x[1])
    return float(mixed.solve(domain, law(nu), [Held("start"), Held("end"), squeezed], steps=2).reactions[2, 1])


def twisted(angle: float, **section: Any) -> tuple[float, statics.Equilibrium]:
    """Return the larger relative error of torque and thrust of Rivlin's twisted cylinder, length 2, radius 1."""
    length = 2.0
    space = Space.paper(straight(length).sweep(circle(8)), elements=8, degree=5, quadrature="auto", **section)
    ends = Support.end(space, "start"), Support.end(space, "end", turn=(0.0, 0.0, angle))
    solution = statics.solve(
        Model([Body(space, law(RATIOS[-1]), formulation="mixed")], ends), load_steps=int(np.ceil(2.0 * angle))
    )
    tau = angle / length
    torque, thrust = solution.moments[1, 2] / (0.5 * np.pi * tau), solution.reactions[1, 2] / (-0.25 * np.pi * tau**2)
    return max(abs(torque - 1.0), abs(thrust - 1.0)), solution


_SOLVE: dict[str, Callable[..., tuple[float, statics.Equilibrium]]] = {SPRING: spring, BENT: bent, PINCHED: pinched}


def run(level: str) -> Iterator[dict[str, Any]]:
    """Solve the cases for each Poisson's ratio with both formulations."""
    full = level == "full"
    for case, solve in _SOLVE.items():
        sections: list[dict[str, int]] = [{"order": k} for k in ((1, 2, 3) if full else (1, 2))]
        if full and case != PINCHED:
            sections += [{"section_degree": n} for n in (3, 4)]
        for k, nu in enumerate(RATIOS):
            target = reference(case, nu, *MESHES[case]) if full else REFERENCE[case][k]
            for formulation in ("displacement", "mixed"):
                for section in sections:
                    yield _point(case, nu, target, formulation, section, solve)
    for angle in (0.5, 2.0, 6.0) if full else (0.5, 2.0):
        for order in (1, 2):
            yield from TWISTED.over((angle,), _twist, order, series=f"mixed, K = {order}")


def _twist(angle: float, order: int) -> dict[str, Any]:
    error, solution = twisted(angle, order=order)
    return {"error": error, "nu": RATIOS[-1]} | _effort(solution)


def _point(
    case: str,
    nu: float,
    target: float,
    formulation: str,
    section: dict[str, int],
    solve: Callable[..., tuple[float, statics.Equilibrium]],
) -> dict[str, Any]:
    def one() -> dict[str, Any]:
        result, solution = solve(nu, formulation, **section)
        return {"error": abs(result / target - 1.0), "result": result} | _effort(solution)

    name = f"K = {section['order']}" if "order" in section else f"N = {section['section_degree']}"
    # Rounded: the difference of two decimals.
    value = float(f"{0.5 - nu:.6g}")
    sweep = Sweep(case, "Taylor-Hood, dolfinx", TOLERANCE)
    return sweep.point(value, one, series=f"{formulation}, {name}", nu=nu, target=target)


def _effort(solution: statics.Equilibrium) -> dict[str, int]:
    pressures = sum(body.pressures.size for body in solution.model.bodies if body.pressures is not None)
    return {"unknowns": solution.model.unknowns + pressures, "newton": solution.newton_iterations}
