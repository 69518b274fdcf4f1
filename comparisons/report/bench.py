"""Isorod beside the fastest of every program: one table of ratios a scene, from records alone."""

from collections.abc import Sequence
from pathlib import Path

from comparisons.bench import biceps
from comparisons.measure.records import Record, part
from comparisons.report import precision
from comparisons.report.html import fold, heading, table
from isorod.output.results import write_beside

TABLE = "bench.md"

QUANTITIES = {"spring": "force", "blade": "ten frequencies", "biceps": "end forces of the motion to rest"}

_PROGRAMS = {"ngsolve": "NGSolve", "calculix": "CalculiX"}

# What each side proves of its own result within the time with checks.
PROOFS = {
    "spring": "balance of forces and hourglass modes in isorod; reactions elsewhere, within the solve",
    "blade": "residuals and a Sturm count in isorod, there hourglass modes too, and in dolfinx; residuals alone in "
    "NGSolve, nothing in CalculiX",
}

HEAD = (
    *("within", "program", "ms", "ms, no checks", "processor ms", "unknowns", "error"),
    *("isorod's share", "no checks", "of processor time"),
)


def program(record: Record) -> str:
    """Return the name of the program of a run, with its version."""
    name = {"cylindrical": "isorod", "fem": "dolfinx"} | _PROGRAMS
    versions = record["versions"]
    known = precision.version(record) if record["method"] == "fem" else versions.get(record["method"], "")
    return f"{name[record['method']]} {known}".strip()


def bare(record: Record) -> float:
    """Return the seconds of a run without what only proves its result."""
    return float(record["seconds"]["total"] - record["seconds"].get("check", 0.0))


def of_scene(records: list[Record], scene: str) -> list[Record]:
    """Return the records of one scene, each configuration with one time."""
    return precision.settled([record for record in records if record.get("scene") == scene])


def fastest(records: list[Record], target: float) -> list[Record]:
    """Return the fastest run of each program that keeps an error, isorod first and then the fastest first."""
    held = [one for one in part(records, "confirm") if one["holds"] and one["target"] <= target]
    sides: dict[str, Record] = {}
    for one in sorted(held, key=lambda one: one["seconds"]["total"]):
        sides.setdefault(program(one), one)
    return sorted(sides.values(), key=lambda one: (one["method"] != "cylindrical", one["seconds"]["total"]))


def ratios(records: list[Record], target: float) -> tuple[float, float] | None:
    """Return the time of the best of all opponents over isorod's, with and without checks; None if one is missing."""
    sides = fastest(records, target)
    if len(sides) < 2 or sides[0]["method"] != "cylindrical":
        return None
    ours, theirs = sides[0], sides[1:]
    with_checks = min(one["seconds"]["total"] for one in theirs) / ours["seconds"]["total"]
    return with_checks, min(map(bare, theirs)) / bare(ours)


def rows(records: list[Record]) -> list[tuple[str, ...]]:
    """Return the rows of a scene's table."""
    found: list[tuple[str, ...]] = []
    for target in precision.targets(records):
        sides = fastest(records, target)
        ours = sides[0] if sides and sides[0]["method"] == "cylindrical" else None
        for one in sides:
            theirs = ours is not None and one is not ours
            found.append(
                (
                    f"{100 * target:g} %",
                    program(one),
                    _milliseconds(one["seconds"]["total"]),
                    _milliseconds(bare(one)),
                    _milliseconds(one["seconds"]["processor"]),
                    f"{one['dofs']:,}",
                    f"{100 * one['error']:.2g} %",
                    _share(one["seconds"]["total"] / ours["seconds"]["total"]) if theirs and ours else "",
                    _share(bare(one) / bare(ours)) if theirs and ours else "",
                    _share(one["seconds"]["processor"] / ours["seconds"]["processor"]) if theirs and ours else "",
                )
            )
    return found


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:,.1f}" if seconds < 0.1 else f"{1e3 * seconds:,.0f}"


def _share(ratio: float) -> str:
    return f"1/{ratio:.0f}" if ratio >= 1.5 else f"{1.0 / ratio:.1f}"


def motions(records: list[Record]) -> list[tuple[str, ...]]:
    """Return the rows of the biceps' table: each mesh, and along its curve the time at the target."""
    found: list[tuple[str, ...]] = []
    for record in part(records, "motion"):
        found.append(
            (
                record["curve"]
                if record["method"] != "cylindrical"
                else f"isorod {record['arguments'].split(' --end')[0]}",
                record["arguments"],
                f"{record['dofs']:,}",
                f"{100 * record['error']:.2g} %",
                f"{record['seconds_motion']:,.1f}",
            )
        )
    return found


def motion(records: list[Record]) -> tuple[Record, str, float] | None:
    """Return isorod's fastest motion within the target, and the fastest curve of the others with its time there."""
    every = part(records, "motion")
    ours = [one for one in every if one["method"] == "cylindrical" and one["error"] <= biceps.TARGET]
    times = {}
    for curve in dict.fromkeys(one["curve"] for one in every if one["method"] != "cylindrical"):
        time = biceps.at([one for one in every if one["curve"] == curve], biceps.TARGET)
        if time is not None:
            times[curve] = time
    if not ours or not times:
        return None
    best = min(times, key=lambda curve: times[curve])
    return min(ours, key=lambda one: one["seconds_motion"]), best, times[best]


def reached(records: list[Record]) -> list[tuple[str, float, float, float | None, int | None]]:
    """Return scene, error, our share with and without checks (one part in so many), and the goal."""
    (setup,) = part(records, "opponents")
    goals = {(scene, target): share for scene, target, share in setup["goals"]}
    found: list[tuple[str, float, float, float | None, int | None]] = []
    for scene in ("spring", "blade"):
        mine = of_scene(records, scene)
        for target in precision.targets(mine):
            share = ratios(mine, target)
            if share is not None:
                found.append((scene, target, *share, goals.get((scene, target))))
    last = motion(of_scene(records, "biceps"))
    if last is not None:
        ours, _, time = last
        plain = time / ours["seconds_steps"] if "seconds_steps" in ours else None
        goal = goals.get(("biceps", biceps.TARGET))
        found.append(("biceps", biceps.TARGET, time / ours["seconds_motion"], plain, goal))
    return found


def summary(records: list[Record]) -> list[str]:
    """Return the ratios, one line each."""
    (setup,) = part(records, "opponents")
    lines = []
    for scene, target, checked, plain, goal in reached(records):
        beside = "" if plain is None else f", {_share(plain)} without checks"
        asked = "" if goal is None else f" (goal 1/{goal})"
        lines.append(
            f"bench, {scene}, {QUANTITIES[scene]} within {100 * target:g} %: {_share(checked)} of the time of the best "
            f"of all programs{beside}{asked}"
        )
    return lines + [f"bench: not measured, {name}: {why}" for name, why in setup["absent"].items()]


def markdown(records: list[Record]) -> str:
    """Return the tables as Markdown."""
    lines = []
    for scene in ("spring", "blade"):
        lines += [
            f"{scene}: {QUANTITIES[scene]}. Checks: {PROOFS[scene]}.",
            "",
            *_marked(HEAD, rows(of_scene(records, scene))),
            "",
        ]
    lines += [
        f"biceps: {QUANTITIES['biceps']}, explicit dynamics.",
        "",
        *_marked(_MOTION, motions(of_scene(records, "biceps"))),
    ]
    return "\n".join([*lines, "", *(f"- {line}" for line in summary(records)), ""])


_MOTION = ("curve", "arguments", "unknowns", "error", "s")


def _marked(head: Sequence[str], lines: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *lines)]


def answer(records: list[Record]) -> list[str]:
    """Return the ratios as HTML."""
    return [f"<p>{line.capitalize()}.</p>" for line in summary(records)]


def section(records: list[Record], folder: Path) -> list[str]:
    """Write the tables as Markdown, and return the study's HTML."""
    write_beside(folder / TABLE, lambda where: where.write_text(markdown(records)))
    lines = [
        heading(2, "Every program side by side"),
        "<p>The fastest of each program within an error, of many meshes and elements of the very same geometry, "
        f"measured in turn in one run. {precision.LUCK.removeprefix('<p>')}",
    ]
    for scene in ("spring", "blade"):
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
        "elements' time is that of a measured step by the number of steps. CalculiX and NGSolve have no contracting "
        "fibres.</p>",
        table(_MOTION, motions(of_scene(records, "biceps")), text=(0, 1)),
        '<p>Every run is a line of JSON in <a href="bench.jsonl">bench.jsonl</a>; the same tables stand in '
        f'<a href="{TABLE}">{TABLE}</a>. Again: <code>make bench</code>.</p>',
    ]


_RUNS = ("program", "curve", "ms", "error", "unknowns", "arguments")


def _run(record: Record) -> tuple[str, ...]:
    return (
        program(record),
        record["curve"],
        _milliseconds(record["seconds"]["total"]),
        f"{100 * record['error']:.2g} %",
        f"{record['dofs']:,}",
        record["arguments"],
    )
