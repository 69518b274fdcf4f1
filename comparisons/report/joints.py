"""The part of the report page about rods with blocks, coupled, beside finite elements of them as one solid."""

from pathlib import Path

from comparisons.measure.records import Record, part
from comparisons.report.html import commands, fold, heading, milliseconds, percent, plain, table

HEAD = ("scene, error within", "side", "cells, sizes, rod", "error", "ms", "unknowns", "coupled: time", "unknowns")

_SIDES = {"coupled": "coupled", "hexahedron": "one solid, bricks", "tetrahedron": "one solid, tetrahedra"}


def best(records: list[Record], scene: str) -> dict[float, dict[str, Record]]:
    """Return the confirmed runs of a scene by target and side, the largest target first."""
    best: dict[float, dict[str, Record]] = {}
    own = [one for one in part(records, "confirm") if one["scene"] == scene]
    for one in sorted(own, key=lambda one: -one["target"]):
        side = one["side"] if one["side"] == "coupled" else one["shape"]
        best.setdefault(one["target"], {})[side] = one
    return best


def rows(records: list[Record]) -> list[tuple[str, ...]]:
    """Return the table of times and unknowns at equal error, without its head, the coupled model's relative too."""
    lines: list[tuple[str, ...]] = []
    for converged in part(records, "converged"):
        for target, sides in best(records, converged["scene"]).items():
            ours = sides.get("coupled")
            for side, name in _SIDES.items():
                first = f"{converged['scene']}, {percent(target)}", name
                if side not in sides:
                    lines.append((*first, "not reached", "", "", "", "", ""))
                    continue
                run = sides[side]
                ratios = "", ""
                if ours is not None and run is not ours:
                    ratios = _ratio(ours["seconds"], run["seconds"]), _ratio(_all(ours), _all(run))
                lines.append(
                    (*first, run["label"], percent(run["error"]), milliseconds(run["seconds"]), _count(run), *ratios)
                )
    return lines


def section(records: list[Record], folder: Path) -> list[str]:
    """Return the study's HTML."""
    work = part(records, "work")
    scenes = part(records, "converged")
    titles = "; ".join(
        f"{one['scene']}: {one['title']}, {' and '.join(one['names'])}, which the finer mesh has to "
        f"{percent(one['uncertainty'])}"
        for one in scenes
    )
    every = [
        (one["scene"], one["side"], one["label"], percent(one["error"]), milliseconds(one["seconds"]), f"{_all(one):,}")
        for one in work
    ]
    return [
        heading(2, "Rods with blocks, beside all of it as one solid"),
        f"<p>Scenes: {titles}. What they converge to is extrapolated from bricks of one solid. Times are of the "
        "processor, one thread, without meshes and compilation; the fastest of both sides were measured again, in "
        "turn. A run counts as reaching an error if all of its kind do that are nowhere coarser.</p>",
        table(HEAD, rows(records), text=(0, 1, 2)),
        commands(["python -m comparisons joints"]),
        fold(
            f"All {len(work)} runs",
            table(("scene", "side", "cells", "error", "ms", "unknowns"), every, text=(0, 1, 2)),
        ),
    ]


def summary(records: list[Record]) -> list[str]:
    """Return the table, one line a row."""
    return plain(HEAD, rows(records))


def answer(records: list[Record]) -> list[str]:
    """Return the main finding as HTML."""
    ratios = []
    for one in part(records, "converged"):
        for target, sides in best(records, one["scene"]).items():
            others = [side for name, side in sides.items() if name != "coupled"]
            if "coupled" in sides and others:
                ratio = _ratio(sides["coupled"]["seconds"], min(other["seconds"] for other in others))
                ratios.append(f"{one['scene']}, {percent(target)}: {ratio}")
    return [f"<p>Rods coupled to blocks, time beside that of the fastest mesh of one solid: {'; '.join(ratios)}.</p>"]


def _all(record: Record) -> int:
    return int(sum(record["unknowns"]))


def _count(record: Record) -> str:
    rod, solid = record["unknowns"]
    return f"{rod:,} and {solid:,}" if rod else f"{solid:,}"


def _ratio(ours: float, theirs: float) -> str:
    return f"1/{theirs / ours:.2g}" if theirs > 1.5 * ours else f"{ours / theirs:.2g} times"
