"""``isorod design``: numbers of a scene that meet targets and limits, with the least of something."""

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

# Rounds on new discretisations until the answer of a model solved as if it were new is that of the design.
_ROUNDS = 3

# Seconds of a solve from which on it is said how many there will be.
LONG = 2.0

# So far these may differ.
SAME = 1e-3

# What refines a run, and a design.
_FINER = re.compile(r"--tolerance \S+ refines until it is met.*")
_CURE = "the optimal parameters are off by so much; give the file a finer space, or none, and begin again"


def main(ours: Sequence[str], theirs: Sequence[str]) -> int:
    """Design a scene with our options and PETSc's; return the exit code: 2 where targets or limits are not met."""
    from isorod.command import printing

    if chosen.usage("design", ours, theirs):
        return 0
    scene, found, _ = chosen.choose("design", ours, theirs, more)
    if scenes.analyses(scene)[0] not in ("statics", "modal"):
        raise InputError(f"design: not in {scene.analysis}; it is in statics and modal analysis")
    options.initialize(theirs)
    with printing.apart() if found.json else nullcontext(), np.errstate(all="ignore"), options.petsc_errors():
        record = _design(scene, found)
    if ending.rank() == 0:
        print(json.dumps(record) if found.json else "\n".join(lines(record)), flush=True)
        notes.show()
    return ending.fail("isorod", record["missed"]) if record["missed"] else 0


def more(parser: Parser, scene: Any) -> None:
    """Add options of the scene's analysis, and of the design."""
    chosen.with_analysis(parser, scene)
    add = parser.add_argument
    add("--vary", action="append", default=[], metavar="NAME=LOWER:UPPER", help="numbers that may change, with bounds")
    add("--target", action="append", default=[], metavar="NAME=VALUE", help="what is measured is to be this")
    add("--limit", action="append", default=[], metavar="NAME<VALUE", help="what is measured is to be below, or above")
    least = parser.add_mutually_exclusive_group()
    least.add_argument("--minimise", "--minimize", metavar="NAME", help="mass, volume, or what is measured")
    least.add_argument("--maximise", "--maximize", metavar="NAME", help="the same, to be the largest")
    add("--table", metavar="FILE.csv", help="target curve: columns of parameters of the scene and of results")
    add("--json", action="store_true", help="print the result as one line of JSON")
    add("--png", metavar="FILE", help="plot the target curve with the results before and after")
    add("--output", metavar="FILE.toml", help="write the scene file with the optimal parameters")


def _design(scene: Any, found: argparse.Namespace) -> dict[str, Any]:
    from isorod.command import solving
    from isorod.design import curves, evaluations, optimise, wanted

    several = {name: scene.with_options(case=name) for name in scene.cases} if scene.cases and not scene.case else {}
    if several and found.table:
        raise InputError("--table: the file has load cases; choose one with --case")
    several = several or {"": scene}
    varied = wanted.varied(found.vary, scene)
    scene = next(iter(several.values()))
    _check(scene, found, {one.name: one.start for one in varied})
    table = read_table(found, scene, varied)
    several = several if table is None else curves.scenes_of(scene, table)
    settings = chosen.settings(scene, found)
    own = evaluations.Evaluations(several, [one.name for one in varied], settings, solving.solve_scene, table)
    x = np.array([one.start for one in varied])
    with scene.locating(), warnings.catch_warnings(action="ignore"):
        before = own.freeze(x)
    seconds = sum(sum(one.seconds.values()) for one in before.solutions)
    if seconds > LONG:
        ending.announce(
            f"a solve takes some {duration(seconds)}; a design takes 5 to 30, at most {optimise.SOLVES} a round"
        )
    known = wanted.Known(before.values, [*several] if table else [])
    asked = wanted.constraints(found.target, "--target", "=", known)
    asked += wanted.constraints(found.limit, "--limit", "<>", known)
    objective = None if table is None else (evaluations.MISFIT, 1.0)
    if found.minimise or found.maximise:
        option = "--minimise" if found.minimise else "--maximise"
        if table is not None:
            raise InputError(
                f"{option}: with --table the curve's misfit is least; give --limit, or leave out the table"
            )
        (name,) = known.named(option, found.minimise or found.maximise)
        objective = name, 1.0 if found.minimise else -1.0
    if not asked and objective is None:
        raise InputError("design: no objective or constraint; give --target, --limit, --minimise, --maximise, --table")
    problem = optimise.Problem(own, varied, asked, objective, tell)
    with scene.locating():
        best, last, error = _found(problem, own, x, before, _concerned(asked, objective, table))
    after = last.values
    anew = optimise.violation(after, asked)
    if anew[0] > max(best.violation[0], SAME):
        best = best._replace(violation=anew)
    if best.trouble and best.violation[0] <= optimise.MET:
        warnings.warn(f"on the way, not at its end: {best.trouble}", stacklevel=2)
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
            one.name: {"before": one.start, "after": values[one.name], "lower": one.lower, "upper": one.upper}
            for one in varied
        },
        "answers": {name: {"before": before.values[name], "after": after[name]} for name in after},
        "units": dict(scene.units),
        "wanted": [str(one) for one in asked],
        "objective": None if objective is None else objective[0],
        "extreme": "largest" if found.maximise else "least",
        "active": best.prices,
        "solves": own.solves,
        "error_estimate": error,
        "missed": missed,
        "again": again(scene, values),
    }
    if table is not None:
        three = {"wanted": table.measured, "before": table.values(before.values), "after": table.values(after)}
        told(record, table, three)
        if found.png and ending.rank() == 0:
            draw(scene, table, three, found.png)
    if found.output and ending.rank() == 0:
        from isorod.output import results

        results.write_whole(Path(found.output), _written(scene, values).encode())
        record["again"] = f"isorod run {shlex.quote(found.output)}"
    return record


def _found(
    problem: Any,
    own: Any,
    x: Any,
    before: Any,
    concerned: Sequence[str],
) -> tuple[Any, Any, float | None]:
    """Return the best, what is measured there of models that know nothing of the way, and the largest error."""
    from isorod.design import optimise

    for _ in range(_ROUNDS):
        best = problem.solve(x, before)
        x = best.x
        before, error, warned = solve_anew(own, x)
        off = max(_apart(best.results.values[name], before.values[name]) for name in concerned)
        if off <= SAME or best.violation[0] > optimise.MET:
            # What cannot be met is not sought again.
            break
    else:
        warnings.warn(
            f"solved as new the design answers {100.0 * off:.2g} % otherwise than on the way: the discretisation, "
            "or the branch of the answer, changes with it",
            stacklevel=2,
        )
    say(warned)
    return best, before, error


def read_table(found: argparse.Namespace, scene: Any, varied: Sequence[Any]) -> Any:
    """Return the curve that a table has, or None; refuse what could not be drawn, before anything is solved."""
    from isorod.design import curves
    from isorod.output.curves import check, read

    if found.png:
        if not found.table:
            raise InputError("--png: what is drawn is a curve; give its --table")
        check(Path(found.png))
    return curves.curve(read(Path(found.table)), scene, varied) if found.table else None


def told(record: dict[str, Any], table: Any, several: Mapping[str, Any]) -> None:
    """Add curves to a record: root of the mean square of what they are off, and each by what it is."""
    from isorod.design.evaluations import MISFIT

    misfit, active = record["answers"][MISFIT], record["active"]
    record["answers"] = {name: one for name, one in record["answers"].items() if "." not in name}
    record["answers"][MISFIT] = {name: float(np.sqrt(one)) for name, one in misfit.items()}
    # Of a square 1 % of it is worth twice as much.
    record["active"] = {name: 0.5 * one for name, one in active.items()}
    record["given"] = {name: one.tolist() for name, one in table.given.items()}
    record["curves"] = {name: {which: one[name].tolist() for which, one in several.items()} for name in table.measured}


def draw(scene: Any, table: Any, several: Mapping[str, Any], path: str) -> None:
    """Draw curves, one over the other."""
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
    """Return what to say where derivatives are differences."""
    return f"derivatives by finite differences, two solves for each number: exact ones are {why}"


def _check(scene: Any, found: argparse.Namespace, values: Mapping[str, float]) -> None:
    """Refuse an output that could not be written, before anything is solved."""
    if not found.output:
        return
    if scene.content is None:
        raise InputError("--output: a ready scene has no file; leave it out, and take the command printed")
    if not found.output.endswith(".toml"):
        raise InputError(f"--output {found.output}: need a name that ends in .toml")
    folder = Path(found.output).parent
    if not folder.is_dir():
        raise InputError(f"--output {found.output}: there is no folder {folder}")
    own = Path(scene.path).parent
    if scene.data and folder.resolve() != own.resolve():
        raise InputError(f"--output {found.output}: the file reads data beside it; write into {own}")
    _written(scene, values)


def _written(scene: Any, values: Mapping[str, float]) -> str:
    """Return the text of a scene's file with other numbers, and those that were typed."""
    from isorod.files.rewritten import rewritten

    return rewritten(Path(scene.path).read_text(encoding="utf-8"), _typed(scene) | dict(values))


def _typed(scene: Any) -> dict[str, float]:
    """Return the numbers that were set on the command line."""
    found = {}
    for change in scene.changes:
        path, _, value = change.partition("=")
        try:
            found[path.strip()] = float(value)
        except ValueError:
            raise InputError(f"--output: --set {change} is no number; write it into the file") from None
    return found


def again(scene: Any, values: Mapping[str, float]) -> str:
    """Return the command that runs a scene with the optimal parameters."""
    numbers = {name: f"{value:.9g}" for name, value in values.items()}
    if scene.content is None:
        words = [word for name, value in numbers.items() for word in (f"--{name.replace('_', '-')}", value)]
        return shlex.join(["isorod", "run", scene.name, *words])
    words = [word for name, value in numbers.items() for word in ("--set", f"{name}={value}")]
    return shlex.join(["isorod", "run", scene.path, *words])


def solve_anew(own: Any, x: Any) -> tuple[Any, float | None, list[warnings.WarningMessage]]:
    """Return the answer of models as if they were new, the largest error, and what was warned of."""
    from isorod.command import solving

    worst: float | None = None
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        after = own.freeze(x)
        for scene, solution in zip(own.scenes.values(), after.solutions, strict=True):
            error = solving.estimate(solution, bool(scene.stresses)).get("error_estimate")
            worst = error if worst is None else max(worst, error or 0.0)
    return after, worst, warned


def say(warned: Sequence[warnings.WarningMessage]) -> None:
    """Warn of what was warned of; what differs in numbers alone, as between load cases, once."""
    for one in {re.sub(r"[\d.]+", "", str(one.message)): one for one in warned}.values():
        warnings.warn(_FINER.sub(_CURE, str(one.message)), one.category, stacklevel=3)


def _concerned(asked: Sequence[Any], objective: tuple[str, float] | None, table: Any) -> list[str]:
    found = [*(one.name for one in asked), *([objective[0]] if objective and table is None else [])]
    return [
        *found,
        *(f"{k}.{name}" for name, one in (table.measured if table else {}).items() for k in range(len(one))),
    ]


def _apart(one: float, other: float) -> float:
    return abs(one - other) / (max(abs(one), abs(other)) or 1.0)


def tell(words: str) -> None:
    """Say on a terminal how far it is."""
    if sys.stderr.isatty():
        ending.announce(words)


def lines(record: Mapping[str, Any]) -> list[str]:
    """Return a design in words: a table before and after, what is active and what it costs, how to run it."""
    rows = [("", "before", "after", "")]
    for name, one in record["parameters"].items():
        bounds = f"between {one['lower']:.6g} and {one['upper']:.6g}"
        rows.append((name, f"{one['before']:.6g}", f"{one['after']:.6g}", bounds))
    asked = {text.split()[0]: text for text in record["wanted"]}
    for name, one in record["answers"].items():
        what = f"required {asked[name].partition(' ')[2]}" if name in asked else ""
        what = record["extreme"] if name == record["objective"] else what
        unit = record["units"].get(re.sub(r"^.*\.|\[.*", "", name), "")
        what = f"{unit}  {what}".strip() if unit and not unit.startswith("(") else what
        rows.append((name, f"{one['before']:.6g}", f"{one['after']:.6g}", what))
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    text = [f"{row[0]:{widths[0]}}  {row[1]:>{widths[1]}}  {row[2]:>{widths[2]}}  {row[3]}".rstrip() for row in rows]
    for name, price in record["active"].items():
        worth = f": 1 % of it is worth {abs(price):.3g} % of {record['objective']}" if record["objective"] else ""
        text.append(f"active: {name}{worth}")
    for name, one in record.get("curves", {}).items():
        text += curve_lines(name, record["given"], one)
    error = record["error_estimate"]
    text.append(f"{record['solves']} solves" + ("" if error is None else f"; error about {100.0 * error:.2g} %"))
    text.append(record["again"])
    return text


def curve_lines(name: str, given: Mapping[str, Sequence[float]], several: Mapping[str, Sequence[float]]) -> list[str]:
    """Return a curve as a table: what is given in each point, and what it is wanted, measured or answered there."""
    columns = {**given, **{f"{name} {which}": one for which, one in several.items()}}
    widths = [max(len(head), 12) for head in columns]
    rows = [[*columns], *([f"{one:.6g}" for one in row] for row in zip(*columns.values(), strict=True))]
    return ["  ".join(f"{one:>{width}}" for one, width in zip(row, widths, strict=True)) for row in rows]
