"""``python -m comparisons.ngsolve spring --degree 2 ... --repeat 6``: one configuration, one JSON line."""

import argparse
import sys
from collections.abc import Sequence
from importlib import metadata
from time import perf_counter
from typing import Any

from comparisons.fem.quadrature import RULES
from comparisons.measure import timing
from isorod.command import ending
from isorod.command.parser import Parser
from isorod.output import results
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring
from meshes import blade, spring
from meshes.mesh import Mesh

MODES = 10


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m comparisons.ngsolve", description="Finite element solutions with NGSolve.")
    parser.add_argument("scene", choices=("spring", "blade"))
    parser.add_argument("--cells", choices=("bricks", "tetrahedra"), default="bricks")
    parser.add_argument("--around", type=int, default=8, help="spring: cells round the wire")
    parser.add_argument("--rings", type=int, default=0, help="spring, bricks: rings round the core")
    parser.add_argument("--along", type=int, default=6, help="blade: cells along the chord")
    parser.add_argument("--across", type=int, default=1, help="blade: cells across the thickness")
    parser.add_argument("--grading", type=float, default=1.0, help="blade: see meshes.blade.build")
    parser.add_argument("--layers", type=int, default=48, help="cells along the rod")
    parser.add_argument("--degree", type=int, choices=(1, 2, 3, 4), default=2, help="of the displacement")
    parser.add_argument("--family", choices=("Lagrange", "S", "hollow"), default="Lagrange", help="of bricks")
    parser.add_argument("--quadrature", type=_rule, help="degree of the rule, or irons14")
    parser.add_argument("--refinements", type=int, default=0, help="blade: corrections of each solve")
    parser.add_argument("--repeat", type=int, default=1, help="runs in this process, the first one cold")
    return parser


def _rule(text: str) -> int | str:
    return text if text in RULES else int(text)


def main(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit code."""
    return ending.run("comparisons.ngsolve", lambda: _main(arguments))


def _main(arguments: Sequence[str]) -> int:
    given = _parser().parse_args(arguments)
    if given.quadrature is None:
        bricks = given.cells == "bricks"
        given.quadrature = 2 * given.degree if bricks else max(1, 2 * given.degree - 2)
    print(results.line(_record(given)))
    return 0


def _mesh(given: argparse.Namespace) -> Mesh:
    order = given.degree if given.cells == "bricks" else 2
    if given.scene == "spring":
        return spring.build(given.cells, given.around, given.layers, order, given.rings)
    return blade.build(given.cells, given.along, given.across, given.layers, order, given.grading)


def _record(given: argparse.Namespace) -> dict[str, Any]:
    import ngsolve

    from comparisons.ngsolve import domain, modal, statics
    from comparisons.ngsolve.space import INVERSE

    ngsolve.SetNumThreads(1)
    ngsolve.ngsglobals.msg_level = 0
    start = perf_counter()
    mesh = domain.build(_mesh(given))
    meshing = perf_counter() - start
    element = given.degree, given.family, given.quadrature
    values: dict[str, Any]
    result: statics.Equilibrium | modal.Modes
    if given.scene == "spring":
        wire = Spring(helix="paper")
        rest, runs = timing.repeated(
            lambda: statics.solve(mesh, (wire.E, wire.nu), wire.travel, *element), given.repeat
        )
        result = rest
        values = {
            "analysis": "statics",
            "force": float(rest.reactions[1, 2]),
            "reactions": rest.reactions,
            "residual_norms": rest.residual_norms,
        }
    else:
        wing = Blade()
        material = wing.E, wing.nu, wing.density
        modes, runs = timing.repeated(
            lambda: modal.solve(mesh, material, MODES, *element, given.refinements), given.repeat
        )
        result = modes
        values = {"analysis": "modal", "frequencies": modes.frequencies, "residuals": modes.residuals}
    record = results.provenance()
    record["versions"]["ngsolve"] = metadata.version("ngsolve")
    return {
        "scene": given.scene,
        "method": "ngsolve",
        **values,
        "dofs": result.dofs,
        "cells": mesh.ne,
        "iterations": result.iterations,
        "options": vars(given),
        "petsc_options": INVERSE,
        "seconds": {"mesh": meshing} | timing.median(runs),
        "warm": given.repeat > 1,
        "runs": runs,
        "peak_memory": timing.peak_memory(),
        **record,
    }


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
