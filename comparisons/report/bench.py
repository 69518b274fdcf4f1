"""Isorod beside the fastest of every program: one table of ratios a scene, from records alone."""

from collections.abc import Callable
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

from comparisons.bench import biceps
from comparisons.measure.records import Record, family, is_ours, part, version
from comparisons.measure.work import AS_RUN
from comparisons.report import precision
from comparisons.report.html import columns, fold, milliseconds, table
from comparisons.report.html import markdown as markdown_table
from comparisons.report.html import section as section_of
from isorod.output.results import write_beside

TABLE = "bench.md"

# Head and rows of a table.
Rows = tuple[tuple[str, ...], list[tuple[str, ...]]]

RODS = {
    "spring": "force",
    "blade": "ten frequencies",
    "tube": "force",
    "tube's stresses": "von Mises stress at three places",
    "core and sheath": "force",
    "core and sheath's stresses": "von Mises stress at three places",
    "hollow blade": "six frequencies",
}
QUANTITIES = RODS | {"biceps": "end forces of the motion to rest"}

# What each side proves of its own result within the time with checks.
PROOFS = {
    "spring": "balance of forces and hourglass modes in isorod; reactions elsewhere, within the solve",
    "blade": "residuals and a Sturm count in isorod, there hourglass modes too, and in dolfinx; residuals alone in "
    "NGSolve",
}
# Of rods with a hole or in layers the same as of those without.
PROOFS |= dict.fromkeys(("tube", "tube's stresses", "core and sheath", "core and sheath's stresses"), PROOFS["spring"])
PROOFS["hollow blade"] = PROOFS["blade"]
_ESTIMATE = f"Isorod {AS_RUN.label} has nothing chosen by hand, and the estimate of its error is a part of its time."

# Isorod's side: a preset that was searched for, or nothing chosen.
BY_HAND = "chosen by hand"


def how(record: Record) -> str:
    """Return how the space of a run of isorod was chosen: by hand, or as by ``isorod run``."""
    return AS_RUN.label if record["arguments"] in AS_RUN.arguments else BY_HAND


def program(record: Record) -> str:
    """Return the program of a run: isorod with its family of elements and how it was chosen, others with versions."""
    if is_ours(record):
        return f"isorod, {family(record)}, {how(record)}"
    if record["method"] == "fem":
        return f"dolfinx {version(record)}".strip()
    return f"NGSolve {record['versions'].get('ngsolve', '')}".strip()


def bare(record: Record) -> float:
    """Return the seconds of a run without checks of its result and without the estimate of its error."""
    seconds = record["seconds"]
    return float(seconds["total"] - seconds.get("check", 0.0) - seconds.get("estimate", 0.0))


def of_scene(records: list[Record], scene: str) -> list[Record]:
    """Return the records of one scene, each configuration with one time."""
    return precision.settled([record for record in records if record.get("scene") == scene])


def scenes(records: list[Record]) -> list[str]:
    """Return the scenes of rods that a run has measured."""
    return [scene for scene in RODS if of_scene(records, scene)]


def fastest(records: list[Record], target: float) -> list[Record]:
    """Return the fastest run of each program that keeps an error: isorod's by hand, as run, then the fastest first."""
    held = [one for one in part(records, "confirm") if one["holds"] and one["target"] <= target]
    sides: dict[str, Record] = {}
    for one in sorted(held, key=lambda one: one["seconds"]["total"]):
        sides.setdefault(how(one) if is_ours(one) else program(one), one)
    order = [BY_HAND, AS_RUN.label]
    return sorted(
        sides.values(), key=lambda one: (order.index(how(one)) if is_ours(one) else len(order), one["seconds"]["total"])
    )


def ratios(records: list[Record], target: float) -> list[tuple[Record, float, float]]:
    """Return isorod's runs, each with the time of the best of all opponents over its, with and without checks."""
    sides = fastest(records, target)
    theirs = [one for one in sides if not is_ours(one)]
    if not theirs:
        return []
    with_checks, without = min(one["seconds"]["total"] for one in theirs), min(map(bare, theirs))
    return [(one, with_checks / one["seconds"]["total"], without / bare(one)) for one in sides if is_ours(one)]


def rows(records: list[Record]) -> Rows:
    """Return head and rows of a scene's table."""
    lines = [
        (target, one, {how(mine): mine for mine in sides if is_ours(mine)})
        for target in precision.targets(records)
        for sides in (fastest(records, target),)
        for one in sides
    ]

    def of(time: Callable[[Record], float], which: str = BY_HAND) -> Callable[[Any], str]:
        """Return the function that gives isorod's time over that of another program."""

        def share(row: Any) -> str:
            _, one, mine = row
            return precision.plain_ratio(time(mine[which]), time(one)) if which in mine and not is_ours(one) else ""

        return share

    wall, processor = (partial(_seconds, name) for name in ("total", "processor"))
    return columns(
        lines,
        {
            "within": lambda row: f"{100 * row[0]:g} %",
            "program": lambda row: program(row[1]),
            "ms": lambda row: milliseconds(wall(row[1])),
            "ms, no checks": lambda row: milliseconds(bare(row[1])),
            "processor ms": lambda row: milliseconds(processor(row[1])),
            "unknowns": lambda row: precision.unknowns(row[1]),
            "error": lambda row: precision.error(row[1]),
            "isorod's share": of(wall),
            "no checks": of(bare),
            "of processor time": of(processor),
            f"share {AS_RUN.label}": of(wall, AS_RUN.label),
        },
    )


def _seconds(name: str, record: Record) -> float:
    return float(record["seconds"][name])


def motions(records: list[Record]) -> Rows:
    """Return head and rows of the biceps' table: each mesh, and along its curve the time at the target."""
    return columns(
        part(records, "motion"),
        {
            "curve": lambda one: program(one) if is_ours(one) else one["curve"],
            "arguments": itemgetter("arguments"),
            "unknowns": precision.unknowns,
            "error": precision.error,
            "s": lambda one: f"{one['seconds_motion']:,.1f}",
        },
    )


def motion(records: list[Record]) -> tuple[list[Record], str, float] | None:
    """Return isorod's motions within the target, and the other programs' fastest curve with its time there.

    Of isorod's the fastest by hand, and that as ``isorod run`` has it.
    """
    every = part(records, "motion")
    held: dict[str, Record] = {}
    for one in sorted(every, key=lambda one: one["seconds_motion"]):
        if is_ours(one) and one["error"] <= biceps.TARGET:
            held.setdefault(how(one), one)
    times = {}
    for curve in dict.fromkeys(one["curve"] for one in every if not is_ours(one)):
        time = biceps.at([one for one in every if one["curve"] == curve], biceps.TARGET)
        if time is not None:
            times[curve] = time
    if not held or not times:
        return None
    best = min(times, key=lambda curve: times[curve])
    return [held[one] for one in (BY_HAND, AS_RUN.label) if one in held], best, times[best]


def reached(records: list[Record]) -> list[tuple[str, float, Record, float, float | None]]:
    """Return scene, error, isorod's run, and the time of the best of all others over its, with and without checks."""
    reached: list[tuple[str, float, Record, float, float | None]] = []
    for scene in scenes(records):
        mine = of_scene(records, scene)
        for target in precision.targets(mine):
            reached += [(scene, target, *one) for one in ratios(mine, target)]
    last = motion(of_scene(records, "biceps"))
    if last is not None:
        runs, _, time = last
        for one in runs:
            plain = time / one["seconds_steps"] if "seconds_steps" in one else None
            reached.append(("biceps", biceps.TARGET, one, time / one["seconds_motion"], plain))
    return reached


def summary(records: list[Record]) -> list[str]:
    """Return the ratios, one line each."""
    (setup,) = part(records, "opponents")
    lines = []
    for scene, target, run, checked, plain in reached(records):
        beside = "" if plain is None else f", {precision.ratio(1.0, plain)} it without checks"
        lines.append(
            f"bench, {scene}, {QUANTITIES[scene]} within {100 * target:g} %: {program(run)}: "
            f"{precision.ratio(1.0, checked)} the time of the best of all programs{beside}"
        )
    return lines + [f"bench: not measured, {name}: {why}" for name, why in setup["absent"].items()]


def markdown(records: list[Record]) -> str:
    """Return the tables as Markdown."""
    lines = []
    for scene in scenes(records):
        lines += [
            f"{scene}: {QUANTITIES[scene]}. Checks: {PROOFS[scene]}. {_ESTIMATE}",
            "",
            markdown_table(*rows(of_scene(records, scene))),
            "",
        ]
    lines += [
        f"biceps: {QUANTITIES['biceps']}, explicit dynamics.",
        "",
        markdown_table(*motions(of_scene(records, "biceps"))),
    ]
    return "\n".join([*lines, "", *(f"- {line}" for line in summary(records)), ""])


def section(records: list[Record], folder: Path) -> list[str]:
    """Write the tables as Markdown, and return the study's HTML."""
    write_beside(folder / TABLE, lambda where: where.write_text(markdown(records)))
    parts: dict[str, list[str]] = {}
    for scene in scenes(records):
        mine = of_scene(records, scene)
        runs = table(*columns(part(mine, "work"), _RUNS), text=(0, 1, 5))
        parts[f"{scene}, {QUANTITIES[scene]}"] = [
            f"<p>Checks: {PROOFS[scene]}.</p>",
            table(*rows(mine), text=(0, 1)),
            fold("Every run", runs, *precision.refused(mine)),
        ]
    parts[f"biceps, {QUANTITIES['biceps']}"] = [
        "<p>Explicit dynamics to rest. The errors are those of the equilibrium that each mesh comes to; the finite "
        "elements' time is that of a measured step by the number of steps. NGSolve has no contracting fibres.</p>",
        table(*motions(of_scene(records, "biceps")), text=(0, 1)),
        '<p>Every run is a line of JSON in <a href="bench.jsonl">bench.jsonl</a>; the same tables stand in '
        f'<a href="{TABLE}">{TABLE}</a>. Again: <code>make bench</code>.</p>',
    ]
    about = (
        "<p>The fastest of each program within an error, of many meshes and elements of the very same geometry, "
        f"measured in turn in one run. {_ESTIMATE} {precision.LUCK.removeprefix('<p>')}"
    )
    return section_of("Every program side by side", about, parts, prefix="Programs")


_RUNS: dict[str, Callable[[Any], object]] = {
    "program": program,
    "curve": itemgetter("curve"),
    "ms": precision.total,
    "error": precision.error,
    "unknowns": precision.unknowns,
    "arguments": itemgetter("arguments"),
}
