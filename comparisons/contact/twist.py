"""Two rods pulled, then twisted once round each other, against the helices of thin rods.

``python -m comparisons.contact.twist [ELEMENTS ...]`` prints both and the time for some numbers of elements.

Source of the scene: 4C Multiphysics' test of beams in line contact; of the values `comparisons.contact.pair`.
"""

import argparse
from time import perf_counter

import numpy as np

from comparisons.contact.pair import TwistedPair
from isorod import statics
from isorod.geometry import center_line, section
from isorod.material import NeoHookean
from isorod.model import Body, Contact, Model, SectionLoad, Support
from isorod.space import Space

RADIUS, LENGTH, STRETCH, MODULUS = 0.0095, 5.0, 1.01, 1e9


def exact() -> TwistedPair:
    """Return the helices of thin rods of this stiffness; the tension is that of the neo-Hookean law at nu = 0."""
    area, second = np.pi * RADIUS**2, np.pi * RADIUS**4 / 4.0
    # P = mu (stretch - 1/stretch) at nu = 0, where mu = E/2 and the other term vanishes.
    tension = 0.5 * MODULUS * area * (STRETCH - 1.0 / STRETCH)
    return TwistedPair(RADIUS, LENGTH, STRETCH, 1.0, tension, MODULUS * second, MODULUS * second)


def model(elements: int, degree: int = 3, order: int = 1, section_points: int = 8) -> Model:
    """Return the two rods, whose ends are pulled, and moved round but not turned about the rod; they may tilt.

    Ends whose sections stay level would bend the rods along layers of ``sqrt(bending/tension)``, 0.048: what is turned
    there less, the rest of the rods is turned more, and their line load is 3.9 % larger.
    """
    bodies, supports, loads = [], [], []
    pull = exact().wrench()[0] / 2.0
    for k, x in enumerate((RADIUS, -RADIUS)):
        rod = center_line.straight(LENGTH, start=(x, 0.0, 0.0)).sweep(section.circle(section_points, RADIUS))
        space = Space(rod, elements=elements, degree=degree, continuity=degree - 1, order=order)
        nodes = (space.layers - 1) * space.layer_nodes + np.arange(space.layer_nodes)
        arms = np.zeros((nodes.size, 3))
        arms[space.is_control_point[nodes], 0] = x
        bodies.append(Body(space, NeoHookean(MODULUS, 0.0)))
        supports += [
            Support.end(space, "start", "xy", body=k),
            Support(nodes, "xy", body=k, turn=(0.0, 0.0, 2.0 * np.pi), arms=arms, space=space),
            # Forces at both ends are equal: this carries nothing.
            Support(np.array([(space.layers // 2) * space.layer_nodes]), "z", body=k, space=space),
        ]
        loads += [
            SectionLoad.end(space, "start", (0.0, 0.0, -pull), k),
            SectionLoad.end(space, "end", (0.0, 0.0, pull), k),
        ]
    return Model(bodies, supports, loads=loads, contacts=[Contact(0, 1)])


def measure(solution: statics.Equilibrium) -> dict[str, float]:
    """Return line load over the exact one, mid-length, and how far the axis is off the helix there, in its radii."""
    pair, contact = exact(), solution.contacts[0]
    # Axis parameters are fractions of the length.
    middle = np.abs(contact.parameters[:, 0] - 0.5) < 0.125
    load = float(contact.pressure[middle] @ contact.areas[middle]) / (0.25 * STRETCH * LENGTH)
    length = np.linspace(0.25, 0.75, 201) * LENGTH
    line = solution.position(0, length / LENGTH)
    away = line - pair.positions(length)
    # Both ends are free along the axis.
    away[:, 2] -= away[:, 2].mean()
    return {"line load": load / pair.line_load(), "helix": float(np.linalg.norm(away, axis=1).max()) / RADIUS}


def main() -> None:
    """Solve and print a row for each number of elements."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("elements", type=int, nargs="*", default=[16, 32], help="along each rod")
    parser.add_argument("--degree", type=int, default=3)
    parser.add_argument("--order", type=int, default=1)
    parser.add_argument("--section-points", type=int, default=8)
    parser.add_argument("--steps", type=int, default=20)
    args = parser.parse_args()
    print(f"exact: line load {exact().line_load():.4f}, helix radius {RADIUS}")
    for elements in args.elements:
        start = perf_counter()
        solution = statics.solve(model(elements, args.degree, args.order, args.section_points), args.steps)
        row = {
            **measure(solution),
            "penetration / radius": solution.contacts[0].relative_penetration,
            "linear solves": solution.newton_iterations,
            "steps": solution.load_steps,
            "cuts": solution.cuts,
            "seconds": perf_counter() - start,
        }
        print(f"{elements} elements:", ", ".join(f"{name} {value:.5g}" for name, value in row.items()), flush=True)


if __name__ == "__main__":
    main()
