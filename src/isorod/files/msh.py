"""Meshes of gmsh (``.msh``, versions 2.2 and 4.1, text or binary), read as data: gmsh itself would run its commands."""

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array, Index
from isorod.errors import InputError

# Kinds of cells in gmsh's numbers: shape, degree, nodes; and of facets: corners, nodes.
_CELLS = {
    4: ("tetrahedron", 1, 4),
    5: ("hexahedron", 1, 8),
    11: ("tetrahedron", 2, 10),
    12: ("hexahedron", 2, 27),
}
_FACETS = {2: (3, 3), 3: (4, 4), 9: (3, 6), 10: (4, 9)}

# Nodes of all kinds of elements up to degree 2; of others nothing is known.
_NODES = {1: 2, 2: 3, 3: 4, 4: 4, 5: 8, 6: 6, 7: 5, 8: 3, 9: 6, 10: 9, 11: 10, 12: 27, 13: 18, 14: 14, 15: 1}
_NODES |= {16: 8, 17: 20, 18: 15, 19: 13}

_VERSIONS = (b"2.2", b"4.1")


class Grid(NamedTuple):
    """A mesh of cells of one kind, with groups of facets.

    Attributes
    ----------
    points
        Nodes, shape ``(n, 3)``.
    cells
        Their nodes in gmsh's order, shape ``(c, m)``.
    shape, degree
        ``"tetrahedron"`` or ``"hexahedron"``, and the degree of the geometry.
    groups
        Corners ``(f, 3 or 4)`` of the facets of each group, by its name, or its number.
    """

    points: Array
    cells: Index
    shape: str
    degree: int
    groups: dict[str, Index]


class _Block(NamedTuple):
    """Elements of one kind on one entity: their nodes by tags, and the physical groups that they are in."""

    kind: int
    nodes: Index
    groups: tuple[int, ...]


@lru_cache(maxsize=4)
def read(content: bytes) -> Grid:
    """Return the mesh in a file of that content.

    Raises
    ------
    InputError
        If it is no such file, is damaged, or has no volume cells or those of several kinds.
    """
    try:
        return _grid(*_parsed(content))
    except InputError:
        raise
    except (ValueError, IndexError, KeyError, OverflowError, MemoryError):
        raise InputError("damaged, or not as gmsh writes .msh files; save it as version 4.1") from None


def _grid(names: dict[tuple[int, int], str], tags: Index, points: Array, blocks: list[_Block]) -> Grid:
    kinds = sorted({one.kind for one in blocks if one.kind in _CELLS})
    if not kinds:
        raise InputError("no tetrahedra or hexahedra are in it; need a mesh in 3-D (gmsh -3), saved with its volumes")
    if len(kinds) > 1:
        kinds_text = " and ".join(f"{_CELLS[kind][0]}s of degree {_CELLS[kind][1]}" for kind in kinds)
        raise InputError(f"{kinds_text} are in it, need cells of one kind")
    shape, degree, _ = _CELLS[kinds[0]]
    cells = np.concatenate([one.nodes for one in blocks if one.kind == kinds[0]])
    used, rows = np.unique(cells, return_inverse=True)
    order = np.argsort(tags)
    where = order[np.searchsorted(tags, used, sorter=order)]
    if not (tags[where] == used).all() or not np.isfinite(points[where]).all():
        raise ValueError
    groups: dict[str, list[Index]] = {}
    for one in blocks:
        for group in one.groups if one.kind in _FACETS else ():
            corners = one.nodes[:, : _FACETS[one.kind][0]]
            numbered = np.searchsorted(used, corners)
            if not (used[np.minimum(numbered, len(used) - 1)] == corners).all():
                raise InputError(f"group {names.get((2, group), group)}: facets whose corners no cell has")
            groups.setdefault(names.get((2, group), str(group)), []).append(numbered)
    members = {name: np.concatenate(parts) for name, parts in groups.items()}
    return Grid(points[where], rows.reshape(cells.shape).astype(np.int64), shape, degree, members)


def _parsed(content: bytes) -> tuple[dict[tuple[int, int], str], Index, Array, list[_Block]]:
    """Return names of physical groups, tags of nodes, nodes, and elements."""
    head = content[:200].split()
    if head[:1] != [b"$MeshFormat"]:
        raise InputError("no mesh of gmsh: it does not begin with $MeshFormat")
    if head[1] not in _VERSIONS:
        version = head[1].decode("ascii", "replace")
        raise InputError(f"version {version:.20} of gmsh's format, need 2.2 or 4.1 (gmsh -save -format msh41)")
    old, binary = head[1] == b"2.2", head[2] == b"1"
    if binary and np.frombuffer(_section(content, b"MeshFormat").split(b"\n", 1)[1][:4], "<i4")[0] != 1:
        raise InputError("binary, of a machine with the other order of bytes; save it as text")
    names = _names(_section(content, b"PhysicalNames"))
    numbers = _Numbers(_section(content, b"Nodes"), binary)
    if old:
        tags, points = _nodes_22(numbers)
        return names, tags, points, list(_elements_22(_Numbers(_section(content, b"Elements"), binary)))
    tags, points = _nodes_41(numbers)
    groups = _groups(_Numbers(_section(content, b"Entities"), binary))
    return names, tags, points, list(_elements_41(_Numbers(_section(content, b"Elements"), binary), groups))


def _section(content: bytes, name: bytes) -> bytes:
    """Return what stands between the lines of a section; nothing if there is none."""
    begin = content.find(b"$" + name)
    if begin < 0:
        return b""
    begin = content.index(b"\n", begin) + 1
    return content[begin : content.rindex(b"$End" + name)]


def _names(text: bytes) -> dict[tuple[int, int], str]:
    """Return the names of physical groups by dimension and number."""
    names = {}
    for line in text.decode("utf-8", "replace").splitlines()[1:]:
        dimension, number, name = line.split(maxsplit=2)
        names[int(dimension), int(number)] = name.strip().strip('"')
    return names


class _Numbers:
    """The numbers of a section, one after the other: words of a text, or bytes."""

    def __init__(self, section: bytes, binary: bool) -> None:
        self.binary, self._at = binary, 0
        self._bytes, self._words = section, [] if binary else section.split()

    def take(self, kind: str, count: int) -> Array:
        """Return so many numbers of a kind: ``i4``, ``i8`` or ``f8``."""
        if count < 0:
            raise ValueError
        if self.binary:
            numbers = np.frombuffer(self._bytes, "<" + kind, count, self._at)
            self._at += numbers.nbytes
            return numbers
        words = self._words[self._at : self._at + count]
        if len(words) < count:
            raise ValueError
        self._at += count
        return np.array(words, dtype=float if kind == "f8" else np.int64)

    def line(self) -> int:
        """Return the number on the line that begins here; the numbers that follow may be bytes."""
        if not self.binary:
            return int(self.take("i8", 1)[0])
        end = self._bytes.index(b"\n", self._at)
        number = int(self._bytes[self._at : end])
        self._at = end + 1
        return number

    def records(self, kind: str, count: int, *more: tuple[str, int]) -> list[Array]:
        """Return so many rows, each of a number of a kind and then ``more``: kind and count."""
        parts = [(kind, 1), *more]
        if self.binary:
            dtype = np.dtype([(f"f{k}", "<" + one, (size,)) for k, (one, size) in enumerate(parts)])
            table = np.frombuffer(self._bytes, dtype, count, self._at)
            self._at += table.nbytes
            return [table[f"f{k}"] for k in range(len(parts))]
        width = sum(size for _, size in parts)
        rows = np.array(self._words[self._at : self._at + count * width]).reshape(count, width)
        self._at += count * width
        ends = np.cumsum([size for _, size in parts])[:-1]
        types = [float if one == "f8" else np.int64 for one, _ in parts]
        return [part.astype(each) for part, each in zip(np.split(rows, ends, axis=1), types, strict=True)]


def _nodes_22(numbers: _Numbers) -> tuple[Index, Array]:
    tags, points = numbers.records("i4", numbers.line(), ("f8", 3))
    return tags.ravel().astype(np.int64), points.astype(float)


def _elements_22(numbers: _Numbers) -> Iterator[_Block]:
    left = numbers.line()
    while left > 0:
        if numbers.binary:
            kind, count, width = map(int, numbers.take("i4", 3))
            rows = numbers.take("i4", count * (1 + width + _NODES[kind])).reshape(count, -1)[:, 1:]
        else:
            _, kind, width = map(int, numbers.take("i4", 3))
            count, rows = 1, numbers.take("i4", width + _NODES[kind])[None]
        left -= count
        for group in np.unique(rows[:, 0]) if width else ():
            own = rows[rows[:, 0] == group]
            yield _Block(kind, own[:, width:].astype(np.int64), (int(group),) if group > 0 else ())
        if not width:
            yield _Block(kind, rows.astype(np.int64), ())


def _groups(numbers: _Numbers) -> dict[tuple[int, int], tuple[int, ...]]:
    """Return the physical groups of the entities of version 4.1, by dimension and tag."""
    groups = {}
    for dimension, count in enumerate(map(int, numbers.take("i8", 4))):
        for _ in range(count):
            tag = int(numbers.take("i4", 1)[0])
            numbers.take("f8", 6 if dimension else 3)
            groups[dimension, tag] = tuple(map(int, numbers.take("i4", int(numbers.take("i8", 1)[0]))))
            if dimension:
                numbers.take("i4", int(numbers.take("i8", 1)[0]))
    return groups


def _nodes_41(numbers: _Numbers) -> tuple[Index, Array]:
    blocks, *_ = map(int, numbers.take("i8", 4))
    tags, points = [np.empty(0, dtype=np.int64)], [np.empty((0, 3))]
    for _ in range(blocks):
        dimension, _, parametric = map(int, numbers.take("i4", 3))
        count = int(numbers.take("i8", 1)[0])
        tags.append(numbers.take("i8", count).astype(np.int64))
        width = 3 + (dimension if parametric else 0)
        points.append(numbers.take("f8", count * width).reshape(count, width)[:, :3])
    return np.concatenate(tags), np.concatenate(points)


def _elements_41(numbers: _Numbers, groups: dict[tuple[int, int], tuple[int, ...]]) -> Iterator[_Block]:
    blocks, *_ = map(int, numbers.take("i8", 4))
    for _ in range(blocks):
        dimension, tag, kind = map(int, numbers.take("i4", 3))
        count, width = int(numbers.take("i8", 1)[0]), 1 + _NODES[kind]
        rows = numbers.take("i8", count * width).reshape(count, width)
        yield _Block(kind, rows[:, 1:].astype(np.int64), groups.get((dimension, tag), ()))
