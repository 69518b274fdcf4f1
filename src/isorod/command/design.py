"""``isorod design``: optimal parameters of a scene under targets and limits."""

import argparse
import json
import re
import shlex
import sys
import warnings
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from isorod import options, scenes
from isorod.command import chosen, ending, notes
from isorod.command.parser import Parser
from isorod.errors import InputError
from isorod.output.words import duration

# Rounds of optimisation, each on the last optimum's own discretisation, until a new solve agrees with the design.
_ROUNDS = 3

# From so many seconds a solve the expected number of solves is announced.
LONG = 2.0

# Relative difference up to which both results agree.
SAME = 1e-3

# The advice of a run, and that of a design in its place.
_FINER = re.compile(r"--tolerance \S+ refines until it is met.*")
_CURE = "the optimal parameters have an error of this size; give the file a finer space, or none, and restart"


def main(ours: Sequence[str], theirs: Sequence[str]) -> int:
    """Design a scene with our options and PETSc's; return the exit code: 2 where targets or limits are not met."""
    from isorod.command import printing

    if chosen.usage("design", ours, theirs):
        return 0
    scene, args, _ = chosen.choose("design", ours, theirs, more)
    if scenes.analyses(scene)[0] not in ("statics", "modal"):
        raise InputError(f"design: not in {scene.analysis}; it is in statics and modal analysis")
    options.initialize(theirs)
    with printing.apart() if args.json else nullcontext(), np.errstate(all="ignore"), options.petsc_errors():
        record = _design(scene, args)
    if ending.rank() == 0:
        print(json.dumps(record) if args.json else "\n".join(lines(record)), flush=True)
        notes.show()
    return ending.fail("isorod", record["missed"]) if record["missed"] else 0


def more(parser: Parser, scene: Any) -> None:
    """Add options of the scene's analysis, and of the design."""
    chosen.with_analysis(parser, scene)
    add = parser.add_argument
    add("--vary", action="append", default=[], metavar="NAME=LOWER:UPPER", help="numbers to vary, with bounds")
    add("--target", action="append", default=[], metavar="NAME=VALUE", help="target value of a result")
    add(
        "--limit",
        action="append",
        default=[],
        metavar="NAME<VALUE",
        help="upper limit of a result, or a lower one with >",
    )
    least = parser.add_mutually_exclusive_group()
    least.add_argument("--minimise", "--minimize", metavar="NAME", help="mass, volume, or a result to minimise")
    least.add_argument("--maximise", "--maximize", metavar="NAME", help="the same, to maximise")
    add("--table", metavar="FILE.csv", help="target curve: columns of parameters of the scene and of results")
    add("--json", action="store_true", help="print the result as one line of JSON")
    add("--png", metavar="FILE", help="plot the target curve with the results before and after")
    add("--output", metavar="FILE.toml", help="write the scene file with the optimal parameters")


def _design(scene: Any, args: argparse.Namespace) -> dict[str, Any]:
    from isorod.command import solving
    from isorod.design import constraints, curves, evaluations, optimise

    several = {name: scene.with_options(case=name) for name in scene.cases} if scene.cases and not scene.case else {}
    if several and args.table:
        raise InputError("--table: the file has load cases; choose one with --case")
    several = several or {"": scene}
    varied = constraints.varied(args.vary, scene)
    scene = next(iter(several.values()))
    _check(scene, args, {parameter.name: parameter.start for parameter in varied})
    table = read_table(args, scene, varied)
    several = several if table is None else curves.scenes_of(scene, table)
    settings = chosen.settings(scene, args)
    own = evaluations.Evaluations(
        several, [parameter.name for parameter in varied], settings, solving.solve_scene, table
    )
    x = np.array([parameter.start for parameter in varied])
    with scene.locating(), warnings.catch_warnings(action="ignore"):
        before = own.freeze(x)
    seconds = sum(sum(solution.seconds.values()) for solution in before.solutions)
    if seconds > LONG:
        ending.announce(
            f"a solve takes some {duration(seconds)}; a design takes 5 to 30, at most {optimise.SOLVES} a round"
        )
    known = constraints.Known(before.values, [*several] if table else [])
    asked = constraints.constraints(args.target, "--target", "=", known)
    asked += constraints.constraints(args.limit, "--limit", "<>", known)
    objective = None if table is None else (evaluations.MISFIT, 1.0)
    if args.minimise or args.maximise:
        option = "--minimise" if args.minimise else "--maximise"
        if table is not None:
            raise InputError(
                f"{option}: with --table the curve's misfit is least; give --limit, or leave out the table"
            )
        (name,) = known.named(option, args.minimise or args.maximise)
        objective = name, 1.0 if args.minimise else -1.0
    if not asked and objective is None:
        raise InputError("design: no objective or constraint; give --target, --limit, --minimise, --maximise, --table")
    problem = optimise.Problem(own, varied, asked, objective, report_progress)
    with scene.locating():
        best, last, error = _found(problem, own, x, before, _concerned(asked, objective, table))
    after = last.values
    anew = optimise.violation(after, asked)
    if anew[0] > max(best.violation[0], SAME):
        best = best._replace(violation=anew)
    if best.trouble and best.violation[0] <= optimise.MET:
        warnings.warn(f"during the optimisation, not at its end: {best.trouble}", stacklevel=2)
    missed = f"targets or limits are not met: {best.violation[1]}" if best.violation[0] > optimise.MET else ""
    held = [name for name in best.prices if " bound " in name]
    if missed and held:
        missed += f", with {' and '.join(held)}"
    if missed and best.trouble:
        missed += f" ({best.trouble})"
    if own.fallback:
        warnings.warn(differences_of(own.fallback), stacklevel=2)
    values = dict(zip(own.names, map(float, best.x), strict=True))
    record = {
        "scene": scene.name,
        "parameters": {
            varying.name: {
                "before": varying.start,
                "after": values[varying.name],
                "lower": varying.lower,
                "upper": varying.upper,
            }
            for varying in varied
        },
        "answers": {name: {"before": before.values[name], "after": after[name]} for name in after},
        "units": dict(scene.units),
        "wanted": [str(requirement) for requirement in asked],
        "objective": None if objective is None else objective[0],
        "extreme": "largest" if args.maximise else "least",
        "active": best.prices,
        "solves": own.solves,
        "error_estimate": error,
        "missed": missed,
        "again": again(scene, values),
    }
    if table is not None:
        three = {"wanted": table.measured, "before": table.values(before.values), "after": table.values(after)}
        add_curves(record, table, three)
        if args.png and ending.rank() == 0:
            draw(scene, table, three, args.png)
    if args.output and ending.rank() == 0:
        from isorod.output import results

        results.write_whole(Path(args.output), _written(scene, values).encode())
        record["again"] = f"isorod run {shlex.quote(args.output)}"
    return record


def _found(
    problem: Any,
    own: Any,
    x: Any,
    before: Any,
    concerned: Sequence[str],
) -> tuple[Any, Any, float | None]:
    """Return the optimum, the results of models built anew there, and the largest error estimate."""
    from isorod.design import optimise

    for _ in range(_ROUNDS):
        best = problem.solve(x, before)
        x = best.x
        before, error, warned = solve_anew(own, x)
        off = max(_apart(best.results.values[name], before.values[name]) for name in concerned)
        if off <= SAME or best.violation[0] > optimise.MET:
            # Targets that cannot be met are not tried again.
            break
    else:
        warnings.warn(
            f"solved anew the design differs by {100.0 * off:.2g} % from the optimisation: the discretisation, "
            "or the branch of equilibria, changes with the parameters",
            stacklevel=2,
        )
    issue_warnings(warned)
    return best, before, error


def read_table(args: argparse.Namespace, scene: Any, varied: Sequence[Any]) -> Any:
    """Return the curve in the table, or None; refuse a plot that cannot be drawn before anything is solved."""
    from isorod.design import curves
    from isorod.output.curves import check, read

    if args.png:
        if not args.table:
            raise InputError("--png: it plots a target curve; give one with --table")
        check(Path(args.png))
    return curves.curve(read(Path(args.table)), scene, varied) if args.table else None


def add_curves(record: dict[str, Any], table: Any, several: Mapping[str, Any]) -> None:
    """Add the curves to a record: their root mean square misfits, and their values by kind (``several``)."""
    from isorod.design.evaluations import MISFIT

    misfit, active = record["answers"][MISFIT], record["active"]
    record["answers"] = {name: value for name, value in record["answers"].items() if "." not in name}
    record["answers"][MISFIT] = {name: float(np.sqrt(value)) for name, value in misfit.items()}
    # Prices are those of the mean square, of which 1 % is 0.5 % of its root.
    record["active"] = {name: 0.5 * price for name, price in active.items()}
    record["given"] = {name: values.tolist() for name, values in table.given.items()}
    record["curves"] = {
        name: {kind: values[name].tolist() for kind, values in several.items()} for name in table.measured
    }


def draw(scene: Any, table: Any, several: Mapping[str, Any], path: str) -> None:
    """Draw the curves of each result in one diagram."""
    from isorod.design import curves
    from isorod.output import picture
    from isorod.output.curves import draw as drawn

    units = {name: unit.strip("()") for name, unit in scene.units.items()}
    drawn(
        curves.columns(table, several),
        str(scene.title if scene.content else scene.name),
        picture.SIZE,
        Path(path),
        units,
    )


def differences_of(why: str) -> str:
    """Return the warning where derivatives are finite differences."""
    return f"derivatives by finite differences, two solves for each number: exact ones are {why}"


def _check(scene: Any, args: argparse.Namespace, values: Mapping[str, float]) -> None:
    """Refuse an output that cannot be written, before anything is solved."""
    if not args.output:
        return
    if scene.content is None:
        raise InputError("--output: a ready scene has no file; leave it out, and take the command printed")
    if not args.output.endswith(".toml"):
        raise InputError(f"--output {args.output}: need a name that ends in .toml")
    folder = Path(args.output).parent
    if not folder.is_dir():
        raise InputError(f"--output {args.output}: there is no folder {folder}")
    own = Path(scene.path).parent
    if scene.data and folder.resolve() != own.resolve():
        raise InputError(f"--output {args.output}: the file reads data beside it; write into {own}")
    _written(scene, values)


def _written(scene: Any, values: Mapping[str, float]) -> str:
    """Return the text of a scene's file with these numbers, and those set on the command line."""
    from isorod.files.rewritten import rewritten

    return rewritten(Path(scene.path).read_text(encoding="utf-8"), _typed(scene) | dict(values))


def _typed(scene: Any) -> dict[str, float]:
    """Return the numbers that were set on the command line."""
    numbers = {}
    for change in scene.changes:
        path, _, value = change.partition("=")
        try:
            numbers[path.strip()] = float(value)
        except ValueError:
            raise InputError(f"--output: --set {change} is no number; write it into the file") from None
    return numbers


def again(scene: Any, values: Mapping[str, float]) -> str:
    """Return the command that runs a scene with the optimal parameters."""
    numbers = {name: f"{value:.9g}" for name, value in values.items()}
    if scene.content is None:
        words = [word for name, value in numbers.items() for word in (f"--{name.replace('_', '-')}", value)]
        return shlex.join(["isorod", "run", scene.name, *words])
    words = [word for name, value in numbers.items() for word in ("--set", f"{name}={value}")]
    return shlex.join(["isorod", "run", scene.path, *words])


def solve_anew(own: Any, x: Any) -> tuple[Any, float | None, list[warnings.WarningMessage]]:
    """Return the results of models built anew, the largest error estimate, and the warnings."""
    from isorod.command import solving

    worst: float | None = None
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        after = own.freeze(x)
        for scene, solution in zip(own.scenes.values(), after.solutions, strict=True):
            error = solving.estimate(solution, bool(scene.stresses)).get("error_estimate")
            worst = error if worst is None else max(worst, error or 0.0)
    return after, worst, warned


def issue_warnings(warned: Sequence[warnings.WarningMessage]) -> None:
    """Issue recorded warnings; those that differ in numbers alone, as between load cases, once."""
    for warning in {re.sub(r"[\d.]+", "", str(warning.message)): warning for warning in warned}.values():
        warnings.warn(_FINER.sub(_CURE, str(warning.message)), warning.category, stacklevel=3)


def _concerned(asked: Sequence[Any], objective: tuple[str, float] | None, table: Any) -> list[str]:
    names = [*(one.name for one in asked), *([objective[0]] if objective and table is None else [])]
    return [
        *names,
        *(f"{k}.{name}" for name, one in (table.measured if table else {}).items() for k in range(len(one))),
    ]


def _apart(one: float, other: float) -> float:
    return abs(one - other) / (max(abs(one), abs(other)) or 1.0)


def report_progress(words: str) -> None:
    """Report the progress on a terminal."""
    if sys.stderr.isatty():
        ending.announce(words)


def lines(record: Mapping[str, Any]) -> list[str]:
    """Return a design as text: a table before and after, prices of active constraints, the command to run it."""
    rows = [("", "before", "after", "")]
    for name, row in record["parameters"].items():
        bounds = f"between {row['lower']:.6g} and {row['upper']:.6g}"
        rows.append((name, f"{row['before']:.6g}", f"{row['after']:.6g}", bounds))
    asked = {text.split()[0]: text for text in record["wanted"]}
    for name, row in record["answers"].items():
        what = f"required {asked[name].partition(' ')[2]}" if name in asked else ""
        what = record["extreme"] if name == record["objective"] else what
        unit = record["units"].get(re.sub(r"^.*\.|\[.*", "", name), "")
        what = f"{unit}  {what}".strip() if unit and not unit.startswith("(") else what
        rows.append((name, f"{row['before']:.6g}", f"{row['after']:.6g}", what))
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    text = [f"{row[0]:{widths[0]}}  {row[1]:>{widths[1]}}  {row[2]:>{widths[2]}}  {row[3]}".rstrip() for row in rows]
    for name, price in record["active"].items():
        worth = f": 1 % of it is worth {abs(price):.3g} % of {record['objective']}" if record["objective"] else ""
        text.append(f"active: {name}{worth}")
    for name, row in record.get("curves", {}).items():
        text += curve_lines(name, record["given"], row)
    error = record["error_estimate"]
    text.append(f"{record['solves']} solves" + ("" if error is None else f"; error about {100.0 * error:.2g} %"))
    text.append(record["again"])
    return text


def curve_lines(name: str, given: Mapping[str, Sequence[float]], several: Mapping[str, Sequence[float]]) -> list[str]:
    """Return a curve as a table: the given numbers of each point, and target, measured or computed values there."""
    columns = {**given, **{f"{name} {kind}": values for kind, values in several.items()}}
    widths = [max(len(head), 12) for head in columns]
    rows = [[*columns], *([f"{one:.6g}" for one in row] for row in zip(*columns.values(), strict=True))]
    return ["  ".join(f"{one:>{width}}" for one, width in zip(row, widths, strict=True)) for row in rows]
