"""Trees of rods from SWC files, as programs that trace vessels, plants and nerve cells write them."""

from collections.abc import Mapping
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.files import schema
from isorod.files.data import Points
from isorod.files.document import Place
from isorod.files.form import call
from isorod.geometry import table

# Points of a rim, and parts of a branch's radius by which the place where it leaves the other one is looked for.
_RIM, _PARTS = 24, 50

# Segments shorter than this fraction of the radius are left out.
_SHORT = 0.1

_COLUMNS = 7


class Sample(NamedTuple):
    """A line of an SWC file: its place ``(3,)``, its radius, and the number of the one before; None of the root."""

    point: Array
    radius: float
    parent: int | None


class Branch(NamedTuple):
    """A path through a tree that others leave sideways alone.

    Attributes
    ----------
    tip
        Number of the sample that it ends at.
    points, radii
        Of its samples, shapes ``(m, 3)`` and ``(m,)``.
    parent
        Number of the branch from whose flank it begins; None of the first.
    """

    tip: int
    points: Array
    radii: Array
    parent: int | None


def branches(
    table: Mapping[str, Any], place: Place, name: str
) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
    """Return the tables of the rods that a tree consists of, and those of their ties, by their names."""
    tree_call = call(place / "tree", schema.TREE, (place / "tree").table(table["tree"]))
    both = next((key for key in ("curve", "copy", "scale") if key in table), None)
    if both is not None:
        raise (place / both).error("it does not go with a tree, which has curves and radii of its own")
    content = (place / "tree" / "file").data(tree_call.arguments["file"])
    made = tree_call.make(content=content)
    rods, ties, names = {}, {}, [f"{name}-{branch.tip}" for branch in made]
    for own, branch in zip(names, made, strict=True):
        curve = {
            "polyline": {"points": Points(branch.points, branch.radii), "tolerance": tree_call.arguments["tolerance"]}
        }
        rods[own] = {key: one for key, one in table.items() if key != "tree"} | {"curve": curve}
        if branch.parent is not None:
            ties[own] = {"slave": f"{own}.start", "master": f"{names[branch.parent]}.outer"}
    return rods, ties


def tree(file: str, tolerance: float, content: bytes) -> list[Branch]:
    """Return the branches of a tree in an SWC file: lines of number, kind, x, y, z, radius, number of the one before.

    Each branch is a rod, called `ROD-7` if it ends at sample 7: sections of the radius at the samples, along a smooth
    line.  At a fork one branch goes on in the thickest; the others begin where they leave its surface, and are welded
    to it.  Where the file begins in a fork, the first goes through from tip to tip.

    Parameters
    ----------
    file
        Its name, beside the scene's file.
    tolerance
        Of the smooth lines, units of length, as of `polyline`.
    """
    samples = _read(file, content)
    found_branches: list[Branch] = []
    for path, parent in _paths(samples):
        points = np.array([samples[k].point for k in path])
        radii = np.array([samples[k].radius for k in path])
        if parent is not None:
            # What is thinner than the branch it leaves is so from its beginning.
            radii[0] = radii[1]
            points, radii = _outside(points, radii, found_branches[parent])
        if len(points) < 2:
            raise InputError(f"{file}: the branch to sample {path[-1]} is within the one it leaves; leave it out")
        apart = np.append(True, np.any(np.diff(points, axis=0) != 0.0, axis=1))
        found_branches.append(Branch(path[-1], points[apart], radii[apart], parent))
    return found_branches


def _read(file: str, content: bytes) -> dict[int, Sample]:
    """Return the samples by their numbers, the root first, each behind the one before it."""
    try:
        _, rows = table.read(content)
    except UnicodeDecodeError as problem:
        raise InputError(f"{file}: byte {content[problem.start]:#04x} is not UTF-8") from None
    samples: dict[int, Sample] = {}
    for row in rows:
        values = row.values
        if len(values) != _COLUMNS or not all(isfinite(one) for one in values):
            need = "number, kind, x, y, z, radius, parent"
            raise InputError(f"{file}:{row.line}: got {row.text!r:.60}, need seven numbers: {need}")
        number, _, *point, radius, parent = values
        if number in samples or number < 0 or number != int(number):
            raise InputError(f"{file}:{row.line}: number {number:g}: need whole numbers, 0 or more, each once")
        if not radius > 0.0:
            raise InputError(f"{file}:{row.line}: radius: got {radius:g}, need a positive length")
        if parent >= 0 and parent not in samples:
            raise InputError(f"{file}:{row.line}: parent {parent:g}: no line above has this number")
        if parent < 0 and samples:
            raise InputError(f"{file}:{row.line}: a second root (parent {parent:g}); one tree a file")
        samples[int(number)] = Sample(np.array(point), radius, None if parent < 0 else int(parent))
    if len(samples) < 2:
        raise InputError(f"{file}: {len(samples)} samples, need two or more")
    return samples


def _paths(samples: Mapping[int, Sample]) -> list[tuple[list[int], int | None]]:
    """Return the numbers along each branch, from where it leaves another, and the number of that one."""
    below: dict[int, list[int]] = {number: [] for number in samples}
    for number, sample in samples.items():
        if sample.parent is not None:
            below[sample.parent].append(number)
    for several in below.values():
        several.sort(key=lambda number: -samples[number].radius)

    def on(number: int) -> list[int]:
        path = [number]
        while below[path[-1]]:
            path.append(below[path[-1]][0])
        return path

    root = next(iter(samples))
    first, *more = [on(number) for number in below[root]]
    trunk = [*more.pop(0)[::-1], root, *first] if more else [root, *first]
    paths: list[tuple[list[int], int | None]] = [(trunk, None)]
    leave = {root: [path[0] for path in more]} | {n: rest[1:] for n, rest in below.items() if n != root}
    for k, (path, _) in enumerate(paths):
        # Samples reached during the search are visited too.
        own = path if k == 0 else path[1:]
        paths += [([number, *on(child)], k) for number in own for child in leave[number]]
    return paths


def _outside(points: Array, radii: Array, other: Branch) -> tuple[Array, Array]:
    """Return the part of a branch that begins where the last of its rim leaves the surface of another one."""
    distances = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    angle = 2.0 * np.pi * np.arange(_RIM) / _RIM
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def at(s: float) -> Array:
        return np.array([np.interp(s, distances, x) for x in points.T])

    begin, step = 0.0, radii[0] / _PARTS
    while begin + step < distances[-1]:
        along = at(begin + 2.0 * step) - at(begin + step)
        across = np.linalg.svd(along[None])[2][1:]
        if (_depth(at(begin + step) + np.interp(begin, distances, radii) * circle @ across, other) > 1.0).any():
            break
        begin += step
    # The rest of a segment between samples may be too short.
    rest = distances > begin + _SHORT * radii[0]
    return np.vstack([at(begin), points[rest]]), np.append(np.interp(begin, distances, radii), radii[rest])


def _depth(places: Array, branch: Branch) -> Array:
    """Return how far places ``(m, 3)`` are from the line of a branch, over its radius there."""
    start, side = branch.points[:-1], np.diff(branch.points, axis=0)
    arm = places[:, None] - start
    share = np.clip(np.einsum("msa,sa->ms", arm, side) / np.einsum("sa,sa->s", side, side), 0.0, 1.0)
    away = np.linalg.norm(arm - share[..., None] * side, axis=2)
    return np.asarray((away / (branch.radii[:-1] + share * np.diff(branch.radii))).min(axis=1))
