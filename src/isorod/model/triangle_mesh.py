"""Rigid obstacles bounded by closed triangle meshes, from arrays or STL files."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array, Index
from isorod.errors import InputError, numbers, positive
from isorod.model.moving import ObstacleMotion

_BINARY = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84
_VERTEX = re.compile(rb"^[ \t]*vertex[ \t]+(.*?)[ \t\r]*$", re.MULTILINE | re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A rigid body bounded by triangles, which rods do not enter.

    Parameters
    ----------
    vertices
        Units of length, shape ``(v, 3)``.
    triangles
        Numbers of vertices, shape ``(t, 3)``, all counterclockwise seen from outside, or all clockwise.
    motion
        How it moves and turns; without, it stands.

    Raises
    ------
    InputError
        If a coordinate is not finite, a vertex does not exist, a triangle has no area, or the surface is not closed.
    """

    vertices: ArrayLike
    triangles: ArrayLike
    motion: ObstacleMotion | None = None

    def __post_init__(self) -> None:
        vertices, numbered = numbers("triangle mesh: vertices", self.vertices), numbers("triangle mesh", self.triangles)
        for name, table in (("vertices", vertices), ("triangles", numbered)):
            if table.ndim != 2 or table.shape[1] != 3 or not table.size:
                raise InputError(f"triangle mesh: {name}: got shape {table.shape}, need (m, 3)")
        bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
        if bad.size:
            raise InputError(
                f"triangle mesh: vertex {bad[0]}: got {tuple(vertices[bad[0]].tolist())}, need finite numbers"
            )
        wrong = ~((numbered >= 0) & (numbered < vertices.shape[0]) & (numbered == np.floor(numbered)))
        if wrong.any():
            k = int(np.argwhere(wrong)[0][0])
            given, count = tuple(numbered[k].tolist()), vertices.shape[0]
            raise InputError(f"triangle mesh: triangle {k}: got {given}, need numbers of the {count} vertices")
        triangles = _closed(numbered.astype(np.int64))
        corners = vertices[triangles]
        sides = corners - np.roll(corners, 1, axis=1)
        area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        flat = np.flatnonzero(area <= 1e-14 * (sides**2).sum(axis=(1, 2)))
        if flat.size:
            raise InputError(f"triangle mesh: triangle {flat[0]} has no area; leave it out")
        middle = corners - corners.mean(axis=(0, 1))
        volume = np.einsum("ti,ti", middle[:, 0], np.cross(middle[:, 1], middle[:, 2])) / 6.0
        if abs(volume) <= 1e-12 * np.abs(middle).max() ** 3:
            raise InputError("triangle mesh: it has no volume; need a surface round a body")
        if self.motion is not None:
            object.__setattr__(self, "motion", self.motion.about(None))
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "triangles", triangles if volume > 0.0 else triangles[:, ::-1])

    @classmethod
    def from_file(cls, path: str | Path, scale: float = 1.0, motion: ObstacleMotion | None = None) -> "TriangleMesh":
        """Return the body in an STL file, ASCII or binary, times ``scale``; corners in the same place are one vertex.

        Parameters
        ----------
        path, scale
            The file, and what its lengths are multiplied by.
        motion
            How it moves and turns; without, it stands.

        Raises
        ------
        InputError
            If the file cannot be read or what is in it is no closed surface: the message names the file.
        """
        positive("triangle mesh: scale", scale, "a positive number")
        try:
            content = Path(path).read_bytes()
        except OSError as problem:
            raise InputError(f"{path}: {problem.strerror}") from None
        try:
            # Makes zeros of both signs the same.
            corners = scale * _corners(content).reshape(-1, 3) + 0.0
            vertices, numbered = np.unique(corners, axis=0, return_inverse=True)
            triangles = numbered.reshape(-1, 3)
            different = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
            return cls(vertices, triangles[different], motion)
        except InputError as problem:
            raise InputError(f"{path}: {problem}") from None

    @property
    def corners(self) -> Array:
        """Corners of the triangles, counterclockwise seen from outside, shape ``(t, 3, 3)``."""
        return np.asarray(self.vertices)[np.asarray(self.triangles)]

    def normals(self) -> Array:
        """Return outward unit normals of face, edges and corners of the triangles, shape ``(t, 7, 3)``.

        The normal of an edge, from a corner to the next, is the mean of both faces', that of a corner the mean of its
        faces', weighted by their angles.
        """
        corners, triangles = self.corners, np.asarray(self.triangles)
        along = _unit(np.roll(corners, -1, axis=1) - corners)
        faces = _unit(np.cross(along[:, 0], along[:, 1]))
        angles = np.arccos(np.clip(-(along * np.roll(along, 1, axis=1)).sum(axis=2), -1.0, 1.0))
        about = np.zeros_like(np.asarray(self.vertices))
        np.add.at(about, triangles, angles[..., None] * faces[:, None])
        edges, numbered = np.unique(np.sort(_edges(triangles), axis=1), axis=0, return_inverse=True)
        beside = np.zeros((len(edges), 3))
        np.add.at(beside, numbered.ravel(), np.repeat(faces, 3, axis=0))
        return np.concatenate(
            [faces[:, None], _unit(beside)[numbered].reshape(-1, 3, 3), _unit(about)[triangles]], axis=1
        )


def _unit(vectors: Array) -> Array:
    """Return vectors of length one; zero stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def _edges(triangles: Index) -> Index:
    """Return both vertices of all edges, three of each triangle, shape ``(3 t, 2)``."""
    return np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)


def _closed(triangles: Index) -> Index:
    """Return triangles if their surface is closed: two at each edge, which traverse it in opposite directions."""
    edges = _edges(triangles)
    _, numbered, counts = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    meeting = counts[numbered.ravel()]
    odd = np.flatnonzero(meeting != 2)
    if odd.size:
        k, count = odd[0] // 3, meeting[odd[0]]
        problem = "is open" if count == 1 else f"is one of {count} triangles"
        raise InputError(
            f"triangle mesh: an edge of triangle {k} {problem}; need a closed surface, two triangles at each edge"
        )
    _, first, counts = np.unique(edges, axis=0, return_index=True, return_counts=True)
    if counts.max() > 1:
        k = first[np.argmax(counts)] // 3
        raise InputError(f"triangle mesh: triangle {k} and one beside it turn in opposite senses; turn one round")
    return triangles


def _corners(content: bytes) -> Array:
    """Return the corners ``(t, 3, 3)`` in an STL file."""
    count = int.from_bytes(content[80:_HEADER], "little")
    if len(content) >= _HEADER and len(content) == _HEADER + count * _BINARY.itemsize:
        return np.frombuffer(content, _BINARY, count, _HEADER)["corners"].astype(float)
    rows = []
    for match in _VERTEX.finditer(content):
        try:
            rows.append([float(word) for word in match[1].split()])
        except ValueError:
            rows.append([])
        if len(rows[-1]) != 3:
            line = content.count(b"\n", 0, match.start()) + 1
            raise InputError(f"line {line}: got {match[1].decode(errors='replace'):.40}, need three numbers")
    if not rows:
        raise InputError(f"got {len(content)} bytes, neither an ASCII nor a whole binary STL file")
    facets = len(re.findall(rb"^[ \t]*endfacet\b", content, re.MULTILINE | re.IGNORECASE))
    if len(rows) != 3 * facets:
        raise InputError(f"got {len(rows)} vertices of {facets} facets, need three of each")
    return np.array(rows).reshape(-1, 3, 3)
