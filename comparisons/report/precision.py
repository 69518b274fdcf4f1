"""Error against run time: what reaches an error fastest, in words and tables."""

import html
from collections.abc import Sequence

from comparisons.measure.records import Record, family, part, side, version
from comparisons.measure.work import MODULES, REPEAT
from comparisons.report.html import commands, milliseconds, percent, table

LUCK = (
    "<p>A run counts as reaching an error if it stays within when the axis alone, and the section alone, is refined "
    "one step. Coarser runs that get there because both errors cancel are listed as such, and do not count. The "
    "fastest of both sides were measured again, in turn. Each configuration has one time on this page, the least of "
    "all its medians.</p>"
)


def versions(records: list[Record]) -> list[str]:
    """Return the versions of dolfinx measured, in the order of the study."""
    return list(dict.fromkeys(version(one) for one in part(records, "work") if one["method"] == "fem"))


def settled(records: list[Record]) -> list[Record]:
    """Return the records with one time for each configuration, the least of its medians, whatever it was run for."""

    def key(record: Record) -> tuple[str, ...]:
        return record["method"], record["arguments"], version(record)

    least: dict[tuple[str, ...], dict[str, float]] = {}
    timed = ("work", "confirm")
    for record in records:
        if record["part"] in timed:
            known = least.setdefault(key(record), record["seconds"])
            least[key(record)] = min(known, record["seconds"], key=lambda seconds: seconds["total"])
    return [one | {"seconds": least[key(one)]} if one["part"] in timed else one for one in records]


def targets(records: list[Record]) -> list[float]:
    """Return the errors that run times are compared at, largest first."""
    return sorted({record["target"] for record in part(records, "confirm")}, reverse=True)


def fastest(
    records: list[Record], method: str, target: float, holds: bool = True, of: str | None = None
) -> Record | None:
    """Return the fastest run of a method within the target, confirmed on finer meshes or (``holds`` False) by luck.

    What is confirmed within a smaller error is so within a larger one.  ``of`` is a version of dolfinx, any if None.
    """
    found = [
        one
        for one in part(records, "confirm")
        if one["method"] == method
        and one["holds"] == holds
        and (one["target"] <= target if holds else one["target"] == target)
        and of in (None, version(one))
    ]
    return min(found, key=lambda one: one["seconds"]["total"], default=None)


def pairs(records: list[Record]) -> list[tuple[float, Record, Record]]:
    """Return the targets that both sides reach, and the fastest of each."""
    found = []
    for target in targets(records):
        ours, theirs = (fastest(records, method, target) for method in ("cylindrical", "fem"))
        if ours and theirs:
            found.append((target, ours, theirs))
    return found


def ratio(ours: float, theirs: float) -> str:
    """Return our time as a share of theirs, in words."""
    return f"1/{theirs / ours:.0f} of" if theirs > 1.5 * ours else f"{ours / theirs:.1f} times"


def shares(records: list[Record], what: str) -> str:
    """Return our share of their ``"time"`` or ``"unknowns"``, smallest to largest over the targets, in words."""
    found = [
        (a["seconds"]["total"], b["seconds"]["total"]) if what == "time" else (a["dofs"], b["dofs"])
        for _, a, b in pairs(records)
    ]
    found.sort(key=lambda pair: pair[0] / pair[1], reverse=True)
    words = list(dict.fromkeys(ratio(*pair) for pair in (found[0], found[-1])))
    return f"{' to '.join(word.removesuffix(' of') for word in words)}{' of' if ' of' in words[-1] else ''} the {what}"


def answer(study: str, quantity: str, records: list[Record]) -> list[str]:
    """Return the answer: one sentence, and the fastest of both sides within each error."""
    records = settled(records)
    if not pairs(records):
        return [f"<p class=big>{study}: no error is reached by both sides.</p>"]
    known = versions(records)
    lines = [
        f"<p class=big><strong>{study}, {quantity}:</strong> to the same error, isorod takes "
        f"{shares(records, 'time')} and {shares(records, 'unknowns')} of the fastest finite elements found.</p>"
    ]
    rows = []
    for target, ours, theirs in pairs(records):
        best = (fastest(records, "fem", target, of=one) for one in known)
        share = ratio(ours["seconds"]["total"], theirs["seconds"]["total"])
        rows.append((percent(target), _bare(share), _cost(ours), *(_cost(one) if one else "none" for one in best)))
    head = ("error within", "share of the time", "isorod", *(f"dolfinx {one}" for one in known))
    return [*lines, f"<div class=answer>{table(head, rows)}</div>"]


def _cost(record: Record) -> str:
    named = f"\n{family(record)}" if record["method"] == "cylindrical" else ""
    return f"{milliseconds(record['seconds']['total'])} ms\n{record['dofs']:,} unknowns{named}"


def _bare(share: str) -> str:
    return share.removesuffix(" of").removesuffix(" times")


def reach(records: list[Record]) -> str:
    """Return the table of the fastest runs within each target, and of what only luck brings there sooner."""
    known = versions(records)
    rows = []
    for target in targets(records):
        best = fastest(records, "fem", target)
        for method, of in (("cylindrical", None), *(("fem", one) for one in known)):
            held, lucky = (fastest(records, method, target, holds, of) for holds in (True, False))
            if held and lucky and lucky["seconds"]["total"] >= held["seconds"]["total"]:
                lucky = None
            for record, holds in ((held, True), (lucky, False)):
                if record is None:
                    continue
                seconds = record["seconds"]
                share = ratio(seconds["total"], best["seconds"]["total"]) if best and method == "cylindrical" else ""
                rows.append(
                    (
                        percent(target),
                        side(record),
                        milliseconds(seconds["total"]),
                        _bare(share) if holds else "errors cancel",
                        f"{record['dofs']:,}",
                        record["curve"],
                        percent(record["error"]),
                        ", ".join(percent(near["error"]) for near in record["finer"]),
                        milliseconds(seconds["check"]) if "check" in seconds else "",
                        f"{record['peak_memory'] / 2**20:.0f}",
                    )
                )
    head = (
        "within",
        "fastest",
        "ms",
        "our share",
        "unknowns",
        "curve",
        "its error",
        "one step finer",
        "check ms",
        "peak MiB",
    )
    return table(head, rows, text=(0, 1, 5))


def runs(work: Sequence[Record]) -> str:
    """Return the table of every run, with its options; error and time first."""
    rows = []
    for record in work:
        seconds = record["seconds"]
        options = record["petsc_options"]
        text = (
            options
            if isinstance(options, str)
            else " ".join(f"-{key} {value}" for key, value in options.items() if value)
        )
        solver = text or " ".join(f"{key} {value}" for key, value in record.get("solver", {}).items())
        rows.append(
            (
                named(record),
                family(record) if record["method"] == "cylindrical" else "",
                percent(record["error"]),
                milliseconds(seconds["total"]),
                f"{record['dofs']:,}",
                milliseconds(seconds["setup"] + seconds.get("forms", 0.0)),
                milliseconds(seconds["assembly"]),
                milliseconds(seconds["solve"]),
                milliseconds(seconds["check"]) if "check" in seconds else "",
                record.get("newton_iterations", record.get("iterations")),
                record["arguments"],
                solver,
            )
        )
    head = (
        "curve",
        "element",
        "error",
        "total ms",
        "unknowns",
        "set-up",
        "assembly",
        "solve",
        "check",
        "iterations",
        "arguments",
        "solver",
    )
    return table(head, rows, text=(0, 1, 10, 11))


def named(record: Record) -> str:
    """Return the name of a run's curve with its side, of dolfinx with the version."""
    return f"{'isorod' if record['method'] == 'cylindrical' else side(record)}: {record['curve']}"


def rerun(study: str, records: list[Record]) -> str:
    """Return where the records are, and what to type to run the study again, and the fastest of each side alone."""
    level, run = records[-1]["level"], records[-1]["run"]
    lines = [f"python -m comparisons {study}" + ("" if level == "full" else f" --level {level}")]
    for _, *both in pairs(records):
        lines += [f"python -m {MODULES[one['method']]} {study} {one['arguments']} --repeat {REPEAT}" for one in both]
    others = versions(records)[1:]
    how = (
        f" (dolfinx {', '.join(others)}: with the Python that has it, --dolfinx PYTHON in the study)" if others else ""
    )
    return (
        f'<p>Every run is a line of JSON in <a href="{study}.jsonl">{study}.jsonl</a>, with options, times by part, '
        f"versions, commit and machine; those of this page have <code>run</code> {html.escape(run)}. To run the study "
        f"again{', and the fastest of each side alone' if len(lines) > 1 else ''}{how}:</p>" + commands(lines)
    )


def refused(records: list[Record]) -> list[str]:
    """Return what was refused on the way, with its one line, as a list; nothing if all ran."""
    found = part(records, "refused")
    lines = [
        f"<li>{html.escape(one['curve'])}, {one['arguments']}: {html.escape(one['message'])}</li>" for one in found
    ]
    return ["<p class=small>Refused:</p><ul class=small>", *lines, "</ul>"] if lines else []


def summary(study: str, quantity: str, records: list[Record]) -> list[str]:
    """Return the run times at each target, one line each."""
    records = settled(records)
    known = versions(records)
    lines = []
    for target, ours, theirs in pairs(records):
        fast, slow = ours["seconds"]["total"], theirs["seconds"]["total"]
        others = [fastest(records, "fem", target, of=one) for one in known if one != version(theirs)]
        beside = "".join(f"; {version(one)} {1e3 * one['seconds']['total']:.0f} ms" for one in others if one)
        lines.append(
            f"{study}, {quantity} within {100 * target:g} %: isorod ({family(ours)}) {1e3 * fast:.0f} ms "
            f"({ours['dofs']:,} unknowns), best dolfinx{f' ({version(theirs)})' if len(known) > 1 else ''} "
            f"{1e3 * slow:.0f} ms ({theirs['dofs']:,}{beside}): {ratio(fast, slow)} the time"
        )
    return lines
