"""Isorod beside the fastest of every program: one table of ratios a scene, from records alone."""

from pathlib import Path

from comparisons.bench import biceps
from comparisons.measure.records import Record, family, part, version
from comparisons.measure.work import AS_RUN
from comparisons.report import precision
from comparisons.report.html import fold, heading, milliseconds, table
from comparisons.report.html import markdown as markdown_table
from isorod.output.results import write_beside

TABLE = "bench.md"

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

HEAD = (
    *("within", "program", "ms", "ms, no checks", "processor ms", "unknowns", "error"),
    *("isorod's share", "no checks", "of processor time", f"share {AS_RUN.label}"),
)


def ours(record: Record) -> bool:
    """Whether a run is isorod's."""
    return bool(record["method"] == "cylindrical")


def how(record: Record) -> str:
    """Return how the space of a run of isorod was chosen: by hand, or as ``isorod run`` has it."""
    return AS_RUN.label if record["arguments"] in AS_RUN.arguments else BY_HAND


def program(record: Record) -> str:
    """Return the program of a run: isorod with its family of elements and how it was chosen, others with versions."""
    if ours(record):
        return f"isorod, {family(record)}, {how(record)}"
    if record["method"] == "fem":
        return f"dolfinx {version(record)}".strip()
    return f"NGSolve {record['versions'].get('ngsolve', '')}".strip()


def bare(record: Record) -> float:
    """Return the seconds of a run without what only proves its result, and without the estimate of its error."""
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
        sides.setdefault(how(one) if ours(one) else program(one), one)
    order = [BY_HAND, AS_RUN.label]
    return sorted(
        sides.values(), key=lambda one: (order.index(how(one)) if ours(one) else len(order), one["seconds"]["total"])
    )


def ratios(records: list[Record], target: float) -> list[tuple[Record, float, float]]:
    """Return isorod's runs, each with the time of the best of all opponents over its, with and without checks."""
    sides = fastest(records, target)
    theirs = [one for one in sides if not ours(one)]
    if not theirs:
        return []
    with_checks, without = min(one["seconds"]["total"] for one in theirs), min(map(bare, theirs))
    return [(one, with_checks / one["seconds"]["total"], without / bare(one)) for one in sides if ours(one)]


def rows(records: list[Record]) -> list[tuple[str, ...]]:
    """Return the rows of a scene's table."""
    found: list[tuple[str, ...]] = []
    for target in precision.targets(records):
        sides = fastest(records, target)
        mine = {how(one): one for one in sides if ours(one)}
        tuned, plain = mine.get(BY_HAND), mine.get(AS_RUN.label)
        for one in sides:
            theirs = not ours(one)
            found.append(
                (
                    f"{100 * target:g} %",
                    program(one),
                    milliseconds(one["seconds"]["total"]),
                    milliseconds(bare(one)),
                    milliseconds(one["seconds"]["processor"]),
                    f"{one['dofs']:,}",
                    f"{100 * one['error']:.2g} %",
                    _share(one["seconds"]["total"] / tuned["seconds"]["total"]) if theirs and tuned else "",
                    _share(bare(one) / bare(tuned)) if theirs and tuned else "",
                    _share(one["seconds"]["processor"] / tuned["seconds"]["processor"]) if theirs and tuned else "",
                    _share(one["seconds"]["total"] / plain["seconds"]["total"]) if theirs and plain else "",
                )
            )
    return found


def _share(ratio: float) -> str:
    return f"1/{ratio:.0f}" if ratio >= 1.5 else f"{1.0 / ratio:.1f}"


def motions(records: list[Record]) -> list[tuple[str, ...]]:
    """Return the rows of the biceps' table: each mesh, and along its curve the time at the target."""
    found: list[tuple[str, ...]] = []
    for record in part(records, "motion"):
        found.append(
            (
                program(record) if ours(record) else record["curve"],
                record["arguments"],
                f"{record['dofs']:,}",
                f"{100 * record['error']:.2g} %",
                f"{record['seconds_motion']:,.1f}",
            )
        )
    return found


def motion(records: list[Record]) -> tuple[list[Record], str, float] | None:
    """Return isorod's motions within the target, and the fastest curve of the others with its time there.

    Of isorod's the fastest by hand, and that as ``isorod run`` has it.
    """
    every = part(records, "motion")
    held: dict[str, Record] = {}
    for one in sorted(every, key=lambda one: one["seconds_motion"]):
        if ours(one) and one["error"] <= biceps.TARGET:
            held.setdefault(how(one), one)
    times = {}
    for curve in dict.fromkeys(one["curve"] for one in every if not ours(one)):
        time = biceps.at([one for one in every if one["curve"] == curve], biceps.TARGET)
        if time is not None:
            times[curve] = time
    if not held or not times:
        return None
    best = min(times, key=lambda curve: times[curve])
    return [held[one] for one in (BY_HAND, AS_RUN.label) if one in held], best, times[best]


def reached(records: list[Record]) -> list[tuple[str, float, Record, float, float | None]]:
    """Return scene, error, isorod's run, and the time of the best of all others over its, with and without checks."""
    found: list[tuple[str, float, Record, float, float | None]] = []
    for scene in scenes(records):
        mine = of_scene(records, scene)
        for target in precision.targets(mine):
            found += [(scene, target, *one) for one in ratios(mine, target)]
    last = motion(of_scene(records, "biceps"))
    if last is not None:
        runs, _, time = last
        for one in runs:
            plain = time / one["seconds_steps"] if "seconds_steps" in one else None
            found.append(("biceps", biceps.TARGET, one, time / one["seconds_motion"], plain))
    return found


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
            markdown_table(HEAD, rows(of_scene(records, scene))),
            "",
        ]
    lines += [
        f"biceps: {QUANTITIES['biceps']}, explicit dynamics.",
        "",
        markdown_table(_MOTION, motions(of_scene(records, "biceps"))),
    ]
    return "\n".join([*lines, "", *(f"- {line}" for line in summary(records)), ""])


_MOTION = ("curve", "arguments", "unknowns", "error", "s")


def section(records: list[Record], folder: Path) -> list[str]:
    """Write the tables as Markdown, and return the study's HTML."""
    write_beside(folder / TABLE, lambda where: where.write_text(markdown(records)))
    lines = [
        heading(2, "Every program side by side"),
        "<p>The fastest of each program within an error, of many meshes and elements of the very same geometry, "
        f"measured in turn in one run. {_ESTIMATE} {precision.LUCK.removeprefix('<p>')}",
    ]
    for scene in scenes(records):
        mine = of_scene(records, scene)
        lines += [
            heading(3, f"Programs: {scene}, {QUANTITIES[scene]}"),
            f"<p>Checks: {PROOFS[scene]}.</p>",
            table(HEAD, rows(mine), text=(0, 1)),
            fold(
                "Every run",
                table(_RUNS, [_run(one) for one in part(mine, "work")], text=(0, 1, 5)),
                *precision.refused(mine),
            ),
        ]
    return [
        *lines,
        heading(3, f"Programs: biceps, {QUANTITIES['biceps']}"),
        "<p>Explicit dynamics to rest. The errors are those of the equilibrium that each mesh comes to; the finite "
        "elements' time is that of a measured step by the number of steps. NGSolve has no contracting fibres.</p>",
        table(_MOTION, motions(of_scene(records, "biceps")), text=(0, 1)),
        '<p>Every run is a line of JSON in <a href="bench.jsonl">bench.jsonl</a>; the same tables stand in '
        f'<a href="{TABLE}">{TABLE}</a>. Again: <code>make bench</code>.</p>',
    ]


_RUNS = ("program", "curve", "ms", "error", "unknowns", "arguments")


def _run(record: Record) -> tuple[str, ...]:
    return (
        program(record),
        record["curve"],
        milliseconds(record["seconds"]["total"]),
        f"{100 * record['error']:.2g} %",
        f"{record['dofs']:,}",
        record["arguments"],
    )
