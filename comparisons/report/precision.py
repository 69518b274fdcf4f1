"""Error against run time: the fastest runs within errors, in words and tables."""

import html
from collections.abc import Callable, Iterable, Sequence
from operator import itemgetter
from typing import Any

from comparisons.measure.records import Record, family, is_ours, part, side, version
from comparisons.measure.work import MODULES, REPEAT
from comparisons.report.html import columns, commands, milliseconds, percent, table

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
    runs = [
        one
        for one in part(records, "confirm")
        if one["method"] == method
        and one["holds"] == holds
        and (one["target"] <= target if holds else one["target"] == target)
        and of in (None, version(one))
    ]
    return min(runs, key=lambda one: one["seconds"]["total"], default=None)


def pairs(records: list[Record]) -> list[tuple[float, Record, Record]]:
    """Return the targets that both sides reach, and the fastest of each."""
    pairs = []
    for target in targets(records):
        ours, theirs = (fastest(records, method, target) for method in ("cylindrical", "fem"))
        if ours and theirs:
            pairs.append((target, ours, theirs))
    return pairs


def ratio(ours: float, theirs: float) -> str:
    """Return our time relative to theirs, in words."""
    return f"1/{theirs / ours:.0f} of" if theirs > 1.5 * ours else f"{ours / theirs:.1f} times"


def ratio_range(records: list[Record], what: str) -> str:
    """Return our ``"time"`` or ``"unknowns"`` relative to theirs, smallest to largest over the targets, in words."""
    values = [
        (a["seconds"]["total"], b["seconds"]["total"]) if what == "time" else (a["dofs"], b["dofs"])
        for _, a, b in pairs(records)
    ]
    values.sort(key=lambda pair: pair[0] / pair[1], reverse=True)
    words = list(dict.fromkeys(ratio(*pair) for pair in (values[0], values[-1])))
    return f"{' to '.join(word.removesuffix(' of') for word in words)}{' of' if ' of' in words[-1] else ''} the {what}"


def answer(study: str, quantity: str, records: list[Record]) -> list[str]:
    """Return the answer: one sentence, and the fastest of both sides within each error."""
    records = settled(records)
    if not pairs(records):
        return [f"<p class=big>{study}: no error is reached by both sides.</p>"]
    known = versions(records)
    rows = [
        (percent(target), ours, theirs, [fastest(records, "fem", target, of=one) for one in known])
        for target, ours, theirs in pairs(records)
    ]
    return [
        f"<p class=big><strong>{study}, {quantity}:</strong> to the same error, isorod takes "
        f"{ratio_range(records, 'time')} and {ratio_range(records, 'unknowns')} of the fastest finite elements.</p>",
        side_by_side(rows, known, lambda one: family(one) if is_ours(one) else ""),
    ]


def side_by_side(
    rows: Iterable[tuple[str, Record, Record, Sequence[Record | None]]],
    known: Sequence[str],
    named: Callable[[Record], str],
) -> str:
    """Return the table of the fastest runs within errors.

    Parameters
    ----------
    rows
        Of each error: its label, isorod's run, the fastest of the others, and that of each version of dolfinx.
    known
        The versions.
    named
        Further entries of a run beside its time and its unknowns; may be empty.
    """

    def cost(record: Record | None) -> str:
        if record is None:
            return "none"
        return "\n".join(filter(None, (f"{total(record)} ms", f"{unknowns(record)} unknowns", named(record))))

    head = ("error within", "share of the time", "isorod", *(f"dolfinx {one}" for one in known))
    cells = ((label, faster(ours, best), cost(ours), *map(cost, each)) for label, ours, best, each in rows)
    return f"<div class=answer>{table(head, cells)}</div>"


def faster(ours: Record, theirs: Record) -> str:
    """Return our time relative to theirs, ``1/7`` or ``1.2``."""
    return plain_ratio(ours["seconds"]["total"], theirs["seconds"]["total"])


def plain_ratio(ours: float, theirs: float) -> str:
    """Return the number of `ratio`, without words."""
    return ratio(ours, theirs).removesuffix(" of").removesuffix(" times")


def reach(records: list[Record]) -> str:
    """Return the table of the fastest runs within each target, and of faster ones whose errors cancel by luck."""
    reached: list[tuple[float, Record, str]] = []
    for target in targets(records):
        best = fastest(records, "fem", target)
        for method, of in (("cylindrical", None), *(("fem", one) for one in versions(records))):
            held, lucky = (fastest(records, method, target, holds, of) for holds in (True, False))
            if held:
                reached.append((target, held, faster(held, best) if best and is_ours(held) else ""))
            if lucky and not (held and lucky["seconds"]["total"] >= held["seconds"]["total"]):
                reached.append((target, lucky, "errors cancel"))
    shown: dict[str, Callable[[Any], object]] = {
        "within": lambda row: percent(row[0]),
        "fastest": lambda row: side(row[1]),
        "ms": lambda row: total(row[1]),
        "our share": lambda row: row[2],
        "unknowns": lambda row: unknowns(row[1]),
        "curve": lambda row: row[1]["curve"],
        "its error": lambda row: error(row[1]),
        "one step finer": lambda row: ", ".join(map(error, row[1]["finer"])),
        "check ms": lambda row: timed("check")(row[1]),
        "peak MiB": lambda row: f"{row[1]['peak_memory'] / 2**20:.0f}",
    }
    return table(*columns(reached, shown), text=(0, 1, 5))


def error(record: Record) -> str:
    """Return the error of a run in percent."""
    return percent(record["error"])


def unknowns(record: Record) -> str:
    """Return the number of degrees of freedom of a run."""
    return f"{record['dofs']:,}"


def timed(*parts: str) -> Callable[[Record], str]:
    """Return the function that gives the milliseconds of parts of a run, nothing where it has none of them."""

    def of(record: Record) -> str:
        known = [record["seconds"][name] for name in parts if name in record["seconds"]]
        return milliseconds(sum(known)) if known else ""

    return of


total = timed("total")


def runs(work: Sequence[Record]) -> str:
    """Return the table of every run, with its options; error and time first."""
    shown: dict[str, Callable[[Any], object]] = {
        "curve": named,
        "element": lambda one: family(one) if is_ours(one) else "",
        "error": error,
        "total ms": total,
        "unknowns": unknowns,
        "set-up": timed("setup", "forms"),
        "assembly": timed("assembly"),
        "solve": timed("solve"),
        "check": timed("check"),
        "iterations": lambda one: one.get("newton_iterations", one.get("iterations")),
        "arguments": itemgetter("arguments"),
        "solver": _solver,
    }
    return table(*columns(work, shown), text=(0, 1, 10, 11))


def _solver(record: Record) -> str:
    """Return PETSc's options of a run, or its solver."""
    options = record["petsc_options"]
    if not isinstance(options, str):
        options = " ".join(f"-{key} {value}" for key, value in options.items() if value)
    return options or " ".join(f"{key} {value}" for key, value in record.get("solver", {}).items())


def named(record: Record) -> str:
    """Return the name of a run's curve with its side, of dolfinx with the version."""
    return f"{'isorod' if is_ours(record) else side(record)}: {record['curve']}"


def rerun(study: str, records: list[Record]) -> str:
    """Return the place of the records, and the commands that run the study, or the fastest of each side, again."""
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
    """Return the refused runs with their messages, as a list; nothing if all ran."""
    refused = part(records, "refused")
    lines = [
        f"<li>{html.escape(one['curve'])}, {one['arguments']}: {html.escape(one['message'])}</li>" for one in refused
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
