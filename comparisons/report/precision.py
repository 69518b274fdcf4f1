"""Error against run time as tables: what reaches an error fastest, and every run."""

import html

from comparisons.measure.records import Record, part
from comparisons.report.html import milliseconds, percent, table

LUCK = (
    "<p>A run counts as reaching an error if it stays within when the axis alone, and the section alone, is refined "
    "one step. Coarser runs that get there because both errors cancel are listed as such. The fastest of both sides "
    "were measured again, in turn; the least of their median times counts.</p>"
)


def targets(records: list[Record]) -> list[float]:
    """Return the errors that run times are compared at, largest first."""
    return sorted({record["target"] for record in part(records, "confirm")}, reverse=True)


def fastest(records: list[Record], method: str, target: float, holds: bool = True) -> Record | None:
    """Return the fastest run of a method within the target, confirmed on finer meshes or (``holds`` False) by luck."""
    found = [one for one in part(records, "confirm") if one["method"] == method and one["target"] == target]
    return next((one for one in found if one["holds"] == holds), None)


def ratio(ours: float, theirs: float) -> str:
    """Return our time as a share of theirs, in words."""
    return f"1/{theirs / ours:.0f} of" if theirs > 1.5 * ours else f"{ours / theirs:.1f} times"


def reach(records: list[Record]) -> str:
    """Return the table of the fastest runs within each target."""
    rows = []
    for target in targets(records):
        best = fastest(records, "fem", target)
        for method, name in (("cylindrical", "cylindrical"), ("fem", "dolfinx")):
            for holds in (True, False):
                record = fastest(records, method, target, holds)
                if record is None:
                    continue
                seconds = record["seconds"]["total"]
                share = ratio(seconds, best["seconds"]["total"]) if best and method == "cylindrical" and holds else ""
                finer = ", ".join(percent(near["error"]) for near in record["finer"])
                rows.append(
                    (
                        percent(target),
                        f"{record['curve']} ({name})" + ("" if holds else ": errors cancel"),
                        f"{record['dofs']:,}",
                        milliseconds(seconds),
                        f"{record['peak_memory'] / 2**20:.0f}",
                        percent(record["error"]),
                        finer,
                        share.removesuffix(" of"),
                    )
                )
    head = ("to reach", "fastest", "unknowns", "ms", "peak MiB", "its error", "one step finer", "time ratio")
    return table(head, rows, text=(0, 1))


def runs(work: list[Record]) -> str:
    """Return the table of every run, with its options."""
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
                record["curve"],
                record["arguments"],
                f"{record['dofs']:,}",
                percent(record["error"]),
                milliseconds(seconds["setup"] + seconds.get("forms", 0.0)),
                milliseconds(seconds["assembly"]),
                milliseconds(seconds["solve"]),
                milliseconds(seconds["total"]),
                record.get("newton_iterations", record.get("iterations")),
                solver,
            )
        )
    head = (
        "curve",
        "arguments",
        "unknowns",
        "error",
        "set-up ms",
        "assembly ms",
        "solve ms",
        "total ms",
        "iterations",
        "solver",
    )
    return table(head, rows, text=(0, 1, 9))


def refused(records: list[Record]) -> list[str]:
    """Return what was refused on the way, with its one line, as a list; nothing if all ran."""
    found = part(records, "refused")
    lines = [
        f"<li>{html.escape(one['curve'])}, {one['arguments']}: {html.escape(one['message'])}</li>" for one in found
    ]
    return ["<p class=small>Refused:</p><ul class=small>", *lines, "</ul>"] if lines else []


def summary(study: str, quantity: str, records: list[Record]) -> list[str]:
    """Return the run times at each target, one line each."""
    lines = []
    for target in targets(records):
        ours, theirs = (fastest(records, method, target) for method in ("cylindrical", "fem"))
        if ours and theirs:
            fast, slow = ours["seconds"]["total"], theirs["seconds"]["total"]
            lines.append(
                f"{study}, {quantity} within {100 * target:g} %: cylindrical element {1e3 * fast:.0f} ms "
                f"({ours['dofs']:,} unknowns), best dolfinx {1e3 * slow:.0f} ms ({theirs['dofs']:,}): "
                f"{ratio(fast, slow)} the time"
            )
    return lines
