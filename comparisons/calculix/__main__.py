"""``python -m comparisons.calculix spring --element C3D20R ... --repeat 6``: one configuration, one JSON line."""

import argparse
import statistics
import sys
from collections.abc import Sequence
from time import perf_counter
from typing import Any

from comparisons.calculix import deck, run
from isorod.command import ending
from isorod.command.parser import Parser
from isorod.output import results
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring
from meshes import blade, spring
from meshes.mesh import Mesh

MODES = 10


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m comparisons.calculix", description="Finite element solutions with CalculiX.")
    parser.add_argument("scene", choices=("spring", "blade"))
    parser.add_argument("--element", choices=tuple(deck.ELEMENTS), default="C3D20R")
    parser.add_argument("--around", type=int, default=8, help="spring: cells round the wire")
    parser.add_argument("--rings", type=int, default=0, help="spring, bricks: rings round the core")
    parser.add_argument("--along", type=int, default=6, help="blade: cells along the chord")
    parser.add_argument("--across", type=int, default=1, help="blade: cells across the thickness")
    parser.add_argument("--grading", type=float, default=1.0, help="blade: see meshes.blade.build")
    parser.add_argument("--layers", type=int, default=48, help="cells along the rod")
    parser.add_argument("--solver", choices=("SPOOLES", "ITERATIVECHOLESKY"), default="SPOOLES")
    parser.add_argument("--repeat", type=int, default=1, help="runs of the program, of which the first does not count")
    return parser


def main(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit code."""
    return ending.run("comparisons.calculix", lambda: _main(arguments))


def _main(arguments: Sequence[str]) -> int:
    print(results.line(_record(_parser().parse_args(arguments))))
    return 0


def _mesh(found: argparse.Namespace) -> Mesh:
    cells, order = "tetrahedra" if found.element == "C3D10" else "bricks", deck.ELEMENTS[found.element]
    if found.scene == "spring":
        return spring.build(cells, found.around, found.layers, order, found.rings)
    return blade.build(cells, found.along, found.across, found.layers, order, found.grading)


def _record(found: argparse.Namespace) -> dict[str, Any]:
    version = run.version()
    start = perf_counter()
    mesh = _mesh(found)
    if found.scene == "spring":
        wire = Spring()
        # With large displacements: linear in Green's strain, St. Venant's and Kirchhoff's law.
        law, step = ["*ELASTIC", f"{wire.E:.12g},{wire.nu:.12g}"], deck.pulled(wire.pull, found.solver)
    else:
        wing = Blade()
        law = ["*ELASTIC", f"{wing.E:.12g},{wing.nu:.12g}", "*DENSITY", f"{wing.density:.12g}"]
        step = deck.vibrating(MODES, found.solver)
    body, nodes = deck.body(mesh, found.element, law)
    meshing = perf_counter() - start
    every = [run.solve(body, step) for _ in range(found.repeat)]
    last, runs = every[-1], [one.seconds for one in every]
    warm = runs[1:] or runs
    values: dict[str, Any]
    if found.scene == "spring":
        reactions = last.totals()
        values = {"analysis": "statics", "force": float(reactions[1, 2]), "reactions": reactions}
    else:
        values = {"analysis": "modal", "frequencies": last.frequencies()}
    record = results.provenance()
    record["versions"]["calculix"] = version
    return {
        "scene": found.scene,
        "method": "calculix",
        **values,
        "dofs": 3 * nodes,
        "cells": len(mesh.cells),
        "iterations": last.iterations,
        "options": vars(found),
        "petsc_options": found.solver,
        "seconds": {"mesh": meshing} | {name: statistics.median(one[name] for one in warm) for name in runs[0]},
        "warm": found.repeat > 1,
        "runs": runs,
        "peak_memory": run.peak_memory(),
        **record,
    }


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
