"""Runs of the bench that are kept, and the one table of run times against other programs that is made of them.

``python -m comparisons.bench.recorded`` writes the table of ``docs/comparisons.md`` anew; with ``--add results`` it
keeps the newest run there first, and draws error against run time of that run.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from comparisons.bench import biceps
from comparisons.measure.records import Record, family, is_ours, newest, part
from comparisons.measure.work import AS_RUN
from comparisons.report import bench as report
from comparisons.report import blade, precision, spring
from comparisons.report.html import markdown
from isorod.command import ending
from isorod.command.parser import Parser
from isorod.errors import InputError
from isorod.output.results import write_beside

FILE = Path(__file__).with_name("recorded.jsonl")
_CHECKOUT = Path(__file__).parents[2]
PAGE = _CHECKOUT / "docs" / "comparisons.md"
_GALLERY = _CHECKOUT / "comparisons" / "gallery"

# What the table stands between on the page.
BEGIN, END = "<!-- run times: made by python -m comparisons.bench.recorded -->", "<!-- end of run times -->"

# The machine does other things from this load on, before the bench begins: times of such a run stand in the table only
# where there are no others.
BUSY = 0.5

HEAD = (
    *("scene, error within", "isorod", "its element", "ms, unknowns", "fastest dolfinx", "share of its time"),
    *("in all runs", "another program, if faster", "run"),
)

_NOTES = (
    "Times in brackets are without what only proves a result: checks, and the estimate of the error that "
    f"`isorod run` makes. *Chosen by hand* is the fastest preset known for the error; *{AS_RUN.label}* has "
    "nothing chosen, and the same space whatever the target error. *In all runs* are the smallest and the largest "
    "share, and of how many runs; a run beside which the machine was busy counts where there is no other."
)


def kept() -> list[Record]:
    """Return the runs that are kept, oldest first."""
    return [json.loads(line) for line in FILE.read_text().splitlines()]


def short(records: list[Record]) -> Record:
    """Return the entries that are kept of a run's records: each program's fastest within each error."""
    (setup,) = part(records, "opponents")
    rows = []
    for scene in report.scenes(records):
        mine = report.of_scene(records, scene)
        for target in precision.targets(mine):
            runs = [_one(one, one["seconds"]["total"], report.bare(one)) for one in report.fastest(mine, target)]
            rows.append({"scene": scene, "target": target, "runs": runs})
    last = report.motion(report.of_scene(records, "biceps"))
    if last is not None:
        ours, best, time = last
        runs = [_one(one, one["seconds_motion"], one["seconds_steps"]) for one in ours]
        theirs = next(one for one in part(records, "motion") if one["curve"] == best and one["error"] <= biceps.TARGET)
        runs.append({"program": report.program(theirs), "unknowns": theirs["dofs"], "seconds": time})
        rows.append({"scene": "biceps", "target": biceps.TARGET, "runs": runs})
    head = {name: records[0][name] for name in ("time", "commit", "machine", "level")}
    command = "`make bench`" if last is not None else "`make bench`, these scenes alone"
    return head | {"command": command, "load": setup["load"], "rows": rows}


def _one(record: Record, seconds: float, bare: float) -> Record:
    entry = {"program": report.program(record), "unknowns": record["dofs"], "seconds": seconds, "bare": bare}
    if not is_ours(record):
        return entry
    return {**entry, "program": "isorod", "how": report.how(record), "family": family(record)} | {
        "error": record["error"],
        "arguments": record["arguments"],
    }


def table(runs: Sequence[Record]) -> str:
    """Return the table, and which runs it is of, as Markdown."""
    rows = []
    for scene, quantity in report.QUANTITIES.items():
        targets = sorted({row["target"] for run in runs for row in run["rows"] if row["scene"] == scene}, reverse=True)
        for target in targets:
            for how in (report.BY_HAND, AS_RUN.label):
                rows += _row(runs, f"{scene}, {quantity}", (scene, target, how))
    numbered = [f"{k}. {_reported(run)}" for k, run in enumerate(runs, 1)]
    return "\n".join([markdown(HEAD, rows), "", _NOTES, "", *numbered])


def _row(runs: Sequence[Record], title: str, key: tuple[str, float, str]) -> list[tuple[str, ...]]:
    """Return the row of a scene, an error and how isorod's space was chosen; none if no run has it."""
    every = [(k, *one) for k, run in enumerate(runs, 1) if (one := _sides(run, *key)) is not None]
    quiet = [one for one in every if not _busy(runs[one[0] - 1])]
    counted = quiet or every
    if not counted:
        return _beyond(runs, title, key)
    run, ours, theirs = counted[-1]
    ratios = sorted(_fastest(one, "dolfinx")["seconds"] / mine["seconds"] for _, mine, one in counted)
    spread = " to ".join(dict.fromkeys(_ratio_text(one) for one in (ratios[0], ratios[-1])))
    dolfinx, best = _fastest(theirs, "dolfinx"), _fastest(theirs, "")
    other = "" if best is dolfinx else f"{_time(best)}: {_ratio_text(best['seconds'] / ours['seconds'])}"
    return [
        (
            f"{title}, {100 * key[1]:g} %",
            key[2],
            ours["family"],
            _time(ours),
            _time(dolfinx),
            f"**{_ratio_text(dolfinx['seconds'] / ours['seconds'])}**",
            f"{spread} ({len(counted)})",
            other,
            str(run) + ("" if quiet else ", busy"),
        )
    ]


def _beyond(runs: Sequence[Record], title: str, key: tuple[str, float, str]) -> list[tuple[str, ...]]:
    """Return the row of an error that isorod's space, which is the same for all of them, does not reach."""
    scene, target, how = key
    for k, run in reversed(list(enumerate(runs, 1))):
        rows = [row for row in run["rows"] if row["scene"] == scene]
        ours = [one for row in rows for one in row["runs"] if one.get("how") == how]
        if ours and target in [row["target"] for row in rows]:
            (one, *_) = ours
            missed = f"not reached: {100 * one['error']:.2g} %, {one['unknowns']:,}"
            return [(f"{title}, {100 * target:g} %", how, one["family"], missed, "", "", "", "", str(k))]
    return []


def _sides(run: Record, scene: str, target: float, how: str) -> tuple[Record, list[Record]] | None:
    """Return isorod's run, and those of other programs, if dolfinx is among them."""
    for row in run["rows"]:
        if (row["scene"], row["target"]) == (scene, target):
            ours = [one for one in row["runs"] if one.get("how") == how]
            theirs = [one for one in row["runs"] if "how" not in one]
            if ours and any(one["program"].startswith("dolfinx") for one in theirs):
                return ours[0], theirs
    return None


def _fastest(runs: Sequence[Record], program: str) -> Record:
    return min((one for one in runs if one["program"].startswith(program)), key=lambda one: one["seconds"])


def _busy(run: Record) -> bool:
    return run["load"] is not None and run["load"] >= BUSY


def _ratio_text(ratio: float) -> str:
    return precision.ratio(1.0, ratio).removesuffix(" of")


def _milliseconds(record: Record) -> str:
    def text(seconds: float) -> str:
        return f"{1e3 * seconds:.1f}" if seconds < 9.95e-3 else f"{1e3 * seconds:,.0f}"

    bare = f" ({text(record['bare'])})" if record.get("bare", record["seconds"]) < record["seconds"] else ""
    return text(record["seconds"]) + bare


def _time(one: Record) -> str:
    named = "" if "how" in one else f"{one['program']}: "
    return f"{named}{_milliseconds(one)}, {one['unknowns']:,}"


def _reported(run: Record) -> str:
    """Return which run it is, in words."""
    machine, load = run["machine"], run["load"]
    where = f"{machine['processor']}, {machine['cores']} cores" if machine else "machine not recorded"
    busy = f"; the machine did other things (load {load:.1f}): to be measured again" if _busy(run) else ""
    return f"{run['time'][:10]}, commit {run['commit']}, {run['command']}; {where}{busy}."


def write(page: Path, runs: Sequence[Record]) -> None:
    """Write the table of runs into the page.

    Raises
    ------
    InputError
        If the page is not there, or has no place for it.
    """
    try:
        head, rest = page.read_text().split(BEGIN)
        tail = rest.split(END)[1]
    except (OSError, ValueError, IndexError):
        raise InputError(f"{page}: it has no table of run times; run this in a checkout") from None
    text = f"{head}{BEGIN}\n{table(runs)}\n{END}{tail}"
    write_beside(page, lambda where: where.write_text(text))


def draw(records: list[Record]) -> None:
    """Draw error against run time of spring and blade into the gallery."""
    for drawn in (spring.PART, blade.PART):
        mine = report.of_scene(records, drawn.study)
        if mine:
            drawn.story(mine, _GALLERY / f"{drawn.study}-work-precision.png", AS_RUN.label)


def main(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit code."""
    return ending.run("comparisons.bench.recorded", lambda: _main(arguments))


def _main(arguments: Sequence[str]) -> int:
    parser = Parser(prog="python -m comparisons.bench.recorded", description="The table of run times, of kept runs.")
    parser.add_argument("--add", metavar="DIR", help="keep the newest run of make bench in this folder of results")
    given: Any = parser.known(arguments)
    if given.add is not None:
        records = newest(Path(given.add), "bench")
        if not records:
            raise InputError(f"results {given.add}: no complete run of the bench; run make bench first")
        lines = [*FILE.read_text().splitlines(), json.dumps(short(records))]
        draw(records)
        write_beside(FILE, lambda where: where.write_text("\n".join(dict.fromkeys(lines)) + "\n"))
    write(PAGE, kept())
    print(table(kept()))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
