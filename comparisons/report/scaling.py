"""The scaling study's part of the report page."""

from collections.abc import Callable
from operator import itemgetter
from pathlib import Path
from typing import Any

from comparisons.measure.records import Record, part
from comparisons.report.html import columns, figure, table
from comparisons.report.html import section as section_of
from comparisons.report.plots import pyplot, save
from comparisons.report.precision import rerun
from comparisons.scaling.cost import CORES, LARGE, NODE, fitted
from comparisons.stability.figure import COLOURS, MARKERS
from isorod.space.basis import PAPER


def section(records: list[Record], folder: Path) -> list[str]:
    """Write the figure of a run of the study and return its HTML."""
    _draw(records, folder / "scaling.png")
    about = (
        "<p>A wire of the spring's make, in more and more coils: twelve elements a coil, as much pull on each however "
        "many there are. One thread a rank, each measurement in a process of its own, warm. Unknowns are those that no "
        "support holds.</p>\n"
    ) + figure(
        "scaling.png",
        "time and memory an unknown by the number of unknowns",
        "Flat is what to look for: whatever the size, an unknown costs the same time (left) and memory (right).",
    )
    parts = {
        "one rank": _sizes(records),
        "ranks": _ranks(records),
        "tangents beside DGEMM": _roofline(records),
        "a cluster, on paper": _cluster(records),
        "raw data, running it again": rerun("scaling", records),
    }
    return section_of("Scaling", about, parts)


def summary(records: list[Record]) -> list[str]:
    """Return the study's main findings, a line each."""
    wires = _wires(records, "statics", PAPER)
    costs = [_microseconds(one) for one in wires]
    lines = [
        f"scaling: statics of {wires[0]['unknowns']:,} to {wires[-1]['unknowns']:,} unknowns take {min(costs):.1f} to "
        f"{max(costs):.1f} µs an unknown, {_kilobytes(wires[-1]):.1f} kB an unknown for the largest"
    ]
    for _, alone, both, times, _ in _pairs(records, 2):
        lines.append(
            f"scaling: two ranks, {alone['analysis']}, {both['unknowns']:,} unknowns: {times:.2f} times as fast"
        )
    best = max(part(records, "roofline"), key=lambda one: one["share"])
    lines.append(f"scaling: tangents run at up to {100 * best['share']:.0f} % of DGEMM ({best['family']})")
    return lines


def _wires(records: list[Record], analysis: str, family: str) -> list[Record]:
    key = (analysis, family, 1)
    wires = [one for one in part(records, "wire") if (one["analysis"], one["family"], one["ranks"]) == key]
    return sorted(wires, key=lambda one: int(one["unknowns"]))


def _microseconds(record: Record) -> float:
    return 1e6 * float(record["total"]) / int(record["unknowns"])


def _kilobytes(record: Record) -> float:
    """Return the growth of the largest rank's memory over the number of all unknowns."""
    return 1e-3 * (max(record["memory"]) - record["memory_before"]) / int(record["unknowns"])


def _pairs(records: list[Record], ranks: int) -> list[tuple[str, Record, Record, float, float]]:
    """Return runs on one rank and on several, how many times as fast these are, and by how much results differ."""
    pairs = []
    for both in part(records, "wire"):
        if both["ranks"] != ranks:
            continue
        alike = _wires(records, both["analysis"], both["family"])
        for alone in (one for one in alike if one["coils"] == both["coils"]):
            off = abs(both["value"] / alone["value"] - 1.0)
            pairs.append((f"{both['analysis']}", alone, both, alone["total"] / both["total"], off))
    return pairs


def _sizes(records: list[Record]) -> str:
    def each(of: Callable[[Record], float], form: str) -> Callable[[Record], str]:
        """Return the function that gives the microseconds of an unknown."""
        return lambda one: f"{1e6 * of(one) / one['unknowns']:{form}}"

    parts = {
        title: each(lambda one, name=name: one["seconds"].get(name, 0.0), ".2f")  # type: ignore[misc]
        for title, name in (("set-up", "setup"), ("assembly", "assembly"), ("solve", "solve"), ("check", "check"))
    }
    shown: dict[str, Callable[[Record], object]] = {
        "": lambda one: f"{one['analysis']}, {one['family']}",
        "unknowns": _unknowns,
        "solves or steps": itemgetter("solves"),
        "s": lambda one: f"{one['total']:.3g}",
        **parts,
        "all": each(itemgetter("total"), ".1f"),
        "all, first run": each(itemgetter("first"), ".1f"),
        "kB an unknown": lambda one: f"{_kilobytes(one):.2f}",
    }
    text = (
        "<p>From set-up to all: µs an unknown, medians of three runs after the first of a process, which gets its "
        "memory from the system. Memory is the peak above what the process had before.</p>"
    )
    return text + table(*columns([one for one in part(records, "wire") if one["ranks"] == 1], shown))


def _unknowns(record: Record) -> str:
    return f"{record['unknowns']:,}"


def _ranks(records: list[Record]) -> str:
    counts = sorted({one["ranks"] for one in part(records, "wire")} - {1})

    def faster(name: str) -> Callable[[Any], str]:
        def of(row: Any) -> str:
            _, alone, both, *_ = row
            mine = both["seconds"].get(name)
            return f"{alone['seconds'][name] / mine:.2f}" if mine else ""

        return of

    shown: dict[str, Callable[[Any], object]] = {
        "": lambda row: row[0],
        "unknowns": lambda row: _unknowns(row[2]),
        "ranks": lambda row: row[2]["ranks"],
        "assembly": faster("assembly"),
        "solve": faster("solve"),
        "all": lambda row: f"{row[3]:.2f}",
        "memory of a rank": lambda row: f"{max(row[2]['memory']) / max(row[1]['memory']):.2f}",
        "results differ by": lambda row: f"{row[4]:.0e}",
    }
    text = "<p>How many times as fast as one rank; memory as a share of that of one.</p>"
    return text + table(*columns((pair for ranks in counts for pair in _pairs(records, ranks)), shown))


def _roofline(records: list[Record]) -> str:
    families = part(records, "roofline")
    shown: dict[str, Callable[[Record], object]] = {
        "": itemgetter("family"),
        "points an unknown": lambda one: f"{one['points'] / one['unknowns']:.1f}",
        "forces": lambda one: f"{1e6 * one['forces']:.2f}",
        "tangent": lambda one: f"{1e6 * one['tangent']:.2f}",
        "extrapolated": lambda one: f"{1e6 * one['extrapolated']:.2f}",
        "GFLOP/s": lambda one: f"{1e-9 * one['rate']:.1f}",
        "of DGEMM": lambda one: f"{100 * one['share']:.0f} %",
    }
    text = (
        f"<p>Processor time of the element loops, µs an unknown, and how many operations a second a tangent's products "
        f"of matrices make of it, beside DGEMM's {1e-9 * families[0]['dgemm']:.1f} GFLOP/s on a thousand rows. What is "
        "lost goes to the law, to moving moduli into place and to adding up entries.</p>"
    )
    return text + table(*columns(families, shown))


def _cluster(records: list[Record]) -> list[str]:
    cost = fitted(_wires(records, "statics", PAPER)[-1])
    best = cost.best(LARGE)
    shown: dict[str, Callable[[int], object]] = {
        "ranks": lambda ranks: f"{ranks:,}",
        "s": lambda ranks: f"{cost.seconds(LARGE, ranks):,.2g}",
        "of that the chain": lambda ranks: f"{100 * cost.chain(ranks) / cost.seconds(LARGE, ranks):.0f} %",
        f"GiB on a node of {CORES} cores": lambda ranks: f"{cost.memory(LARGE) / ranks * CORES / 2**30:,.3g}",
    }
    return [
        f"<p>{LARGE:,} unknowns of the same wire, from the largest run above: an unknown takes "
        f"{1e6 * cost.unknown:.1f} µs and {1e-3 * cost.bytes:.1f} kB, whatever the number of ranks: each works on its "
        "own stretch of the axis. What does not divide is the chain of joints between ranks: they couple in a row, "
        f"and one after the other takes {cost.joint / 1e6:.1f} million operations in each of {cost.solves} solves, at "
        "the rate at which this machine factorises bands. Time on P ranks is N c / P + P d; it is least where both are "
        "equal.</p>",
        table(*columns(sorted({1, CORES, 16 * CORES, best}), shown), text=()),
        f"<p>So {best:,} ranks are the most that pay. Nodes of {NODE} GiB that memory asks for at least: "
        f"{cost.nodes(LARGE):,}. Beyond that the chain has to be cut in halves, again and again (cyclic reduction), "
        "whose length grows with the logarithm of the number of ranks.</p>",
    ]


def _draw(records: list[Record], path: Path) -> None:
    from matplotlib import ticker

    chart, (left, right) = pyplot().subplots(1, 2, figsize=(10.0, 4.4), layout="constrained")
    curves = list(dict.fromkeys((one["analysis"], one["family"]) for one in part(records, "wire") if one["ranks"] == 1))
    for k, (analysis, family) in enumerate(curves):
        runs = _wires(records, analysis, family)
        sizes = [one["unknowns"] for one in runs]
        look = {
            "color": COLOURS[k % len(COLOURS)],
            "marker": MARKERS[k % len(MARKERS)],
            "label": f"{analysis}, {family}",
        }
        left.loglog(sizes, [_microseconds(one) for one in runs], **look)
        # A small process grows by what it loads.
        large = [one for one in runs if one["unknowns"] > 5_000]
        right.semilogx([one["unknowns"] for one in large], [_kilobytes(one) for one in large], **look)
    _scales(left, "µs an unknown")
    left.yaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
    left.yaxis.set_major_formatter(ticker.FormatStrFormatter("%g"))
    left.yaxis.set_minor_formatter(ticker.NullFormatter())
    _scales(right, "memory above the start [kB an unknown]")
    right.set_ylim(0.0, None)
    chart.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    save(chart, path, 130)


def _scales(axes: Any, what: str) -> None:
    axes.set(xlabel="unknowns", ylabel=what)
    axes.grid(True, which="both", alpha=0.3)
