"""Meshes of boxes as gmsh writes them: any version, text or binary, bricks or tetrahedra, with groups of facets."""

import struct
from collections.abc import Sequence
from itertools import product

import numpy as np

from isorod.arrays import Array, Index

# Of a brick, whose corners are numbered x first.
_CORNERS = np.array([0, 1, 3, 2, 4, 5, 7, 6])
_TETRAHEDRA = np.array([[0, 1, 3, 7], [0, 1, 7, 5], [0, 5, 7, 4], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7]])


def box(
    size: Sequence[float] = (2.0, 2.0, 1.0),
    parts: Sequence[int] = (2, 2, 2),
    corner: Sequence[float] = (-1.0, -1.0, -1.0),
    bricks: bool = False,
) -> tuple[Array, Index, dict[str, Index]]:
    """Return points, cells, and the facets of ``bottom`` and ``top`` of a box."""
    count = np.array(parts) + 1
    lattice = np.array(list(product(*map(range, count[::-1]))))[:, ::-1]
    points = np.array(corner) + lattice * np.array(size) / np.array(parts)
    low = np.array(list(product(*map(range, parts))))
    corners = np.array(list(product((0, 1), repeat=3)))[:, ::-1]
    step = np.array([1, count[0], count[0] * count[1]])
    bricked = (low[:, None] + corners) @ step
    cells = bricked[:, _CORNERS] if bricks else bricked[:, _TETRAHEDRA].reshape(-1, 4)
    faces = {}
    for name, k in (("bottom", 0), ("top", parts[2])):
        on = lattice[:, 2] == k
        if bricks:
            table = cells[:, [[0, 1, 2, 3], [4, 5, 6, 7]]].reshape(-1, 4)
        else:
            table = cells[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3)
        faces[name] = table[on[table].all(axis=1)]
    return points, cells, faces


def content(
    points: Array, cells: Index, faces: dict[str, Index], version: str = "4.1", binary: bool = False, first: int = 7
) -> bytes:
    """Return what the file of a mesh holds; nodes are numbered from ``first`` on, backwards."""
    tags = first + np.arange(len(points))[::-1]
    kind = 5 if cells.shape[1] == 8 else 4
    blocks = [(3, 1, kind, (), tags[cells])]
    for k, one in enumerate(faces.values(), 1):
        blocks.append((2, k, 3 if one.shape[1] == 4 else 2, (10 + k,), tags[one]))
    names = [f'2 {10 + k} "{name}"' for k, name in enumerate(faces, 1)]
    parts = [f"$MeshFormat\n{version} {int(binary)} 8\n".encode()]
    parts += [struct.pack("<i", 1) + b"\n"] if binary else []
    parts += [
        b"$EndMeshFormat\n",
        "\n".join(["$PhysicalNames", str(len(names)), *names, "$EndPhysicalNames\n"]).encode(),
    ]
    body = _new if version == "4.1" else _old
    return b"".join(parts) + body(points, tags, blocks, binary)


def _new(points, tags, blocks, binary):
    rows: list[tuple[str, Sequence[float]]] = [("q", (0, 0, len(blocks) - 1, 1))]
    for _, tag, _, groups, _ in sorted(blocks, key=lambda one: one[0]):
        rows += [("i", (tag,)), ("d", 6 * (0.0,)), ("q", (len(groups),)), ("i", groups), ("q", (0,))]
    found = _section("Entities", rows, binary)
    rows = [("q", (1, len(points), tags.min(), tags.max())), ("i", (3, 1, 0)), ("q", (len(points),)), ("q", tags)]
    found += _section("Nodes", [*rows, ("d", points.ravel())], binary)
    rows = [("q", (len(blocks), sum(len(one[-1]) for one in blocks), 1, 1000))]
    for dimension, tag, kind, _, nodes in blocks:
        numbered = np.insert(nodes, 0, 1 + np.arange(len(nodes)), axis=1)
        rows += [("i", (dimension, tag, kind)), ("q", (len(nodes),)), ("q", numbered.ravel())]
    return found + _section("Elements", rows, binary)


def _old(points, tags, blocks, binary):
    rows: list[tuple[str, Sequence[float]]] = []
    for tag, point in zip(tags, points, strict=True):
        rows += [("i", (tag,)), ("d", point)]
    found = _section("Nodes", rows, binary, len(points))
    rows, count = [], 0
    for _, tag, kind, groups, nodes in blocks:
        group = groups[0] if groups else 0
        if binary:
            rows.append(("i", (kind, len(nodes), 2)))
        for row in nodes:
            count += 1
            rows.append(("i", (count, group, tag, *row) if binary else (count, kind, 2, group, tag, *row)))
    return found + _section("Elements", rows, binary, count)


def _section(name, rows, binary, count=None):
    head = b"" if count is None else f"{count}\n".encode()
    if binary:
        body = b"".join(struct.pack(f"<{len(values)}{kind}", *values) for kind, values in rows)
    else:
        body = "\n".join(" ".join(repr(float(v)) if k == "d" else str(int(v)) for v in row) for k, row in rows).encode()
    return f"${name}\n".encode() + head + body + f"\n$End{name}\n".encode()


# A bar that is pressed by 0.01 on the top of `box`, in a file without analysis and supports; ends with its contact.
BAR_ON_BOX = """
[rod.bar]
curve = {straight = {start = [-1.5, 0.0, 0.29], end = [1.5, 0.0, 0.29]}}
section = {circle = 0.3}
law = {NeoHookean = {E = 20.0, nu = 0.3}}
density = 1.0
space = {elements = 3}
[solid.block]
mesh = "block.msh"
law = {NeoHookean = {E = 5.0, nu = 0.3}}
density = 1.0
held = "bottom"
[contact.on]
first = "bar"
second = "block.top"
"""
