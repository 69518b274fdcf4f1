"""``isorod identify``: numbers of a scene, such as constants of its laws, from measured curves."""

import json
import warnings
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np

from isorod import options, scenes
from isorod.command import chosen, ending, notes
from isorod.command.parser import Parser
from isorod.errors import InputError


def main(ours: Sequence[str], theirs: Sequence[str]) -> int:
    """Identify numbers of a scene with our options and PETSc's; return the exit code."""
    from isorod.command import printing

    if chosen.usage("identify", ours, theirs):
        return 0
    scene, args, _ = chosen.choose("identify", ours, theirs, more)
    if scenes.analyses(scene)[0] not in ("statics", "modal"):
        raise InputError(f"identify: not in {scene.analysis}; it is in statics and modal analysis")
    if scene.cases and not scene.case:
        raise InputError("identify: the file has load cases; choose one with --case")
    if args.table is None:
        raise InputError("identify: the table of measured values is missing: --table test.csv")
    options.initialize(theirs)
    with printing.apart() if args.json else nullcontext(), np.errstate(all="ignore"), options.petsc_errors():
        record = _identify(scene, args)
    if ending.rank() == 0:
        print(json.dumps(record) if args.json else "\n".join(lines(record)), flush=True)
        notes.show()
    return 0


def more(parser: Parser, scene: Any) -> None:
    """Add options of the scene's analysis, and of the identification."""
    chosen.with_analysis(parser, scene)
    add = parser.add_argument
    add("--table", metavar="FILE.csv", help="measured values: a column for each number of the scene and each result")
    add("--vary", action="append", default=[], metavar="NAME=LOWER:UPPER", help="parameters to identify, with bounds")
    add("--json", action="store_true", help="print the result as one line of JSON")
    add("--png", metavar="FILE", help="plot the measured and the computed curves")


def _identify(scene: Any, args: Any) -> dict[str, Any]:
    from isorod.command import solving
    from isorod.command.design import (
        SAME,
        again,
        differences_of,
        draw,
        issue_warnings,
        read_table,
        report_progress,
        solve_anew,
    )
    from isorod.design import constraints, curves, evaluations, identify

    several = constraints.varied(args.vary, scene)
    table = read_table(args, scene, several)
    names = [one.name for one in several]
    own = evaluations.Evaluations(
        curves.scenes_of(scene, table), names, chosen.settings(scene, args), solving.solve_scene
    )
    with scene.locating():
        with warnings.catch_warnings(action="ignore"):
            # The warnings that count are those of the last solve.
            best = identify.identify(own, several, table, report_progress)
        after, error, warned = solve_anew(own, best.x)
    issue_warnings(warned)
    off = float(np.abs(table.off(after.values) - table.off(best.results)).max())
    if off > SAME:
        warnings.warn(
            f"solved anew, results differ from the fit by up to {100.0 * off:.2g} % of the largest value: the "
            "discretisation, or the branch of equilibria, changes with the parameters",
            stacklevel=2,
        )
    if own.fallback:
        warnings.warn(differences_of(own.fallback), stacklevel=2)
    two = {"measured": table.measured, "answered": table.values(best.results)}
    if args.png and ending.rank() == 0:
        draw(scene, table, two, args.png)
    # With as many values as parameters there is no misfit from which to estimate the deviation.
    exact = sum(map(len, table.measured.values())) == len(several)
    deviation = [None if exact else float(one) for one in np.sqrt(np.diag(best.covariance))]
    values = dict(zip(own.names, map(float, best.x), strict=True))
    return {
        "scene": scene.name,
        "parameters": {
            one.name: {"before": one.start, "found": values[one.name], "standard_error": deviation[k]}
            for k, one in enumerate(several)
        },
        "bounds": [
            one.name
            for one in several
            if min(abs(values[one.name] - one.lower), abs(values[one.name] - one.upper)) <= 1e-6 * abs(one.start)
        ],
        "covariance": best.covariance.tolist(),
        "given": {name: one.tolist() for name, one in table.given.items()},
        "curves": {name: {which: one[name].tolist() for which, one in two.items()} for name in table.measured},
        "misfit": best.misfit,
        "error_estimate": error,
        "solves": own.solves,
        "again": again(scene, values),
    }


def lines(record: Mapping[str, Any]) -> list[str]:
    """Return the result as text: parameters with their standard errors, curves beside the measured ones."""
    from isorod.command.design import curve_lines

    text, width = [], max(len(name) for name in record["parameters"])
    for name, row in record["parameters"].items():
        bound = ", at its bound: the optimum lies beyond" if name in record["bounds"] else ""
        spread = "" if row["standard_error"] is None else f" +- {row['standard_error']:.2g}"
        text.append(f"{name:{width}}  {row['found']:.8g}{spread} (began at {row['before']:g}){bound}")
    for name, row in record["curves"].items():
        text += curve_lines(name, record["given"], row)
    error = record["error_estimate"]
    text.append(
        f"misfit {100.0 * record['misfit']:.2g} % of the largest; {record['solves']} solves"
        + ("" if error is None else f"; error about {100.0 * error:.2g} %")
    )
    text.append(record["again"])
    return text
