"""Centre lines of random scenes: what a file says of them, and points along them that isorod has no part in."""

from dataclasses import dataclass
from typing import Any

import numpy as np

Array = Any

# Lengths of a chain's helices and arcs are summed over so many pieces.
_MANY = 2000


@dataclass(frozen=True)
class Line:
    """A line: its text, points ``(n, 3)`` evenly along it, where a section's x points, and its parameter's last value.

    ``ends`` are its unit tangents; ``halved`` is whether half of its parameter is its middle.
    """

    text: dict[str, Any]
    points: Array
    normal: Array
    last: float
    ends: tuple[Array, Array]
    halved: bool = True

    @property
    def length(self) -> float:
        """Its length."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    def u(self, share: float) -> float:
        """Return the parameter at a share of the length."""
        return share * self.last


def _even(points: Array, pieces: int) -> Array:
    """Return points evenly along a polygon of very many."""
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    at = np.linspace(0.0, along[-1], pieces + 1)
    return np.stack([np.interp(at, along, points[:, k]) for k in range(3)], axis=1)


def _turned(vector: Array, axis: Array, angle: float) -> Array:
    return (
        vector * np.cos(angle) + np.cross(axis, vector) * np.sin(angle) + axis * (axis @ vector) * (1.0 - np.cos(angle))
    )


def draw(rng: np.random.Generator, radius: float, kind: str, pieces: int = 240, start: Any = None) -> Line:
    """Return a line of a kind that a rod of a radius can follow as a thin wire."""
    length = radius * rng.uniform(100.0, 250.0)
    if kind == "straight":
        if start is None:
            points = np.linspace([0.0, 0.0, 0.0], [0.0, 0.0, length], pieces + 1)
            return Line({"straight": float(length)}, points, np.eye(3)[0], 1.0, (np.eye(3)[2],) * 2)
        way = _unit(rng)
        end = start + length * way
        text = {"straight": {"start": start.tolist(), "end": end.tolist()}}
        return Line(text, np.linspace(start, end, pieces + 1), np.zeros(3), 1.0, (way, way))
    if kind == "arc":
        around, angle, phase = radius * rng.uniform(40.0, 80.0), rng.uniform(100.0, 300.0), rng.uniform(0.0, 90.0)
        at = np.radians(phase + np.linspace(0.0, angle, pieces + 1))
        points = np.stack([around * np.cos(at), around * np.sin(at), 0.0 * at], axis=1)
        text = {"arc": {"radius": float(around), "angle": float(angle), "phase": float(phase)}}
        ends = np.stack([-np.sin(at), np.cos(at), 0.0 * at], axis=1)[[0, -1]]
        return Line(text, points, np.array([0.0, 0.0, 1.0]), float(np.ceil(angle / 90.0)), tuple(ends))
    if kind == "helix":
        around, pitch = radius * rng.uniform(30.0, 50.0), radius * rng.uniform(4.0, 30.0)
        turns, left = float(rng.uniform(0.5, 4.0)), bool(rng.random() < 0.3)
        at = np.linspace(0.0, 2.0 * np.pi * turns, pieces + 1)
        hand = -1.0 if left else 1.0
        points = np.stack([around * np.cos(at), hand * around * np.sin(at), pitch * at / (2.0 * np.pi)], axis=1)
        text = {
            "helix": {"radius": float(around), "pitch": float(pitch), "turns": turns} | ({"left": True} if left else {})
        }
        last = float(np.ceil(8.0 * turns - 1e-9))
        rise = np.full_like(at, pitch / (2.0 * np.pi * around))
        ways = np.stack([-np.sin(at), hand * np.cos(at), rise], axis=1) / np.sqrt(1.0 + rise[0] ** 2)
        return Line(text, points, np.array([0.0, 0.0, 1.0]), last, (ways[0], ways[-1]))
    if kind == "fillet":
        count, side = int(rng.integers(3, 6)), radius * rng.uniform(100.0, 160.0)
        corners = [np.zeros(3) if start is None else start]
        way = _unit(rng)
        for _ in range(count - 1):
            corners.append(corners[-1] + side * way)
            across = np.cross(way, _unit(rng))
            way = _turned(way, across / np.linalg.norm(across), np.radians(rng.uniform(40.0, 110.0)))
        bend = radius * rng.uniform(25.0, 40.0)
        text = {"polyline": {"points": np.array(corners).round(6).tolist(), "fillet": float(bend)}}
        points = _rounded(np.array(corners).round(6), bend)
        sides = np.diff(np.array(corners).round(6), axis=0)[[0, -1]]
        ends = tuple(side / np.linalg.norm(side) for side in sides)
        return Line(text, _even(points, pieces), np.zeros(3), np.nan, ends, halved=False)
    return _chain(rng, radius, pieces, start)


def _rounded(corners: Array, bend: float) -> Array:
    """Return points along a polygon with arcs at its corners."""
    found = [corners[:1]]
    for before, at, after in zip(corners, corners[1:], corners[2:], strict=False):
        one, other = (way / np.linalg.norm(way) for way in (before - at, after - at))
        half = 0.5 * np.arccos(np.clip(one @ other, -1.0, 1.0))
        center = at + bend / np.sin(half) * (one + other) / np.linalg.norm(one + other)
        begin, end = (at + bend / np.tan(half) * way - center for way in (one, other))
        angle = np.pi - 2.0 * half
        s = np.linspace(0.0, 1.0, _MANY)[:, None]
        found.append(center + (np.sin((1.0 - s) * angle) * begin + np.sin(s * angle) * end) / np.sin(angle))
    return np.concatenate([*found, corners[-1:]])


def _chain(rng: np.random.Generator, radius: float, pieces: int, start: Any) -> Line:
    begin = np.zeros(3) if start is None else start
    tangent = _unit(rng)
    normal = np.cross(tangent, _unit(rng))
    normal /= np.linalg.norm(normal)
    text: dict[str, Any] = {"direction": tangent.tolist(), "normal": normal.tolist(), "start": begin.tolist()}
    first, points = tangent, [begin[None]]
    told: list[dict[str, Any]] = []
    for _ in range(int(rng.integers(2, 6))):
        here = points[-1][-1]
        kind = str(rng.choice(["straight", "arc", "helix"], p=(0.35, 0.45, 0.2))) if told else "straight"
        s = np.linspace(0.0, 1.0, _MANY)[:, None]
        if kind == "straight":
            length = radius * rng.uniform(30.0, 90.0)
            told.append({"straight": float(length)})
            points.append(here + s * length * tangent)
            continue
        roll = float(rng.choice([0.0, 90.0, -90.0, rng.uniform(-180.0, 180.0)]))
        normal = _turned(normal, tangent, np.radians(roll))
        around = float(radius * rng.uniform(25.0, 40.0))
        if kind == "arc":
            angle = float(rng.uniform(20.0, 180.0) * rng.choice([-1.0, 1.0]))
            told.append({"arc": {"radius": around, "angle": angle} | ({"roll": roll} if roll else {})})
            side = np.sign(angle) * normal
            at = np.radians(abs(angle)) * s
            points.append(here + around * (np.sin(at) * tangent + (1.0 - np.cos(at)) * side))
            last = float(at[-1, 0])
            tangent, side = (
                np.cos(last) * tangent + np.sin(last) * side,
                np.cos(last) * side - np.sin(last) * tangent,
            )
            normal = np.sign(angle) * side
            continue
        pitch, turns = float(radius * rng.uniform(-20.0, 20.0)), float(rng.uniform(0.3, 2.0))
        told.append({"helix": {"radius": around, "pitch": pitch, "turns": turns} | ({"roll": roll} if roll else {})})
        # The axis is a radius towards the normal; its direction is such that the tangent rises to the binormal.
        binormal, rise = np.cross(tangent, normal), pitch / (2.0 * np.pi)
        size = np.hypot(around, rise)
        axis = (around * binormal + rise * tangent) / size
        circle = (around * tangent - rise * binormal) / size
        at = 2.0 * np.pi * turns * s
        middle = here + around * normal
        points.append(middle - around * np.cos(at) * normal + around * np.sin(at) * circle + rise * at * axis)
        last = float(at[-1, 0])
        out, along = -np.cos(last) * normal + np.sin(last) * circle, np.sin(last) * normal + np.cos(last) * circle
        tangent, normal = (around * along + rise * axis) / size, -out
    found = np.concatenate(points)
    length = float(np.linalg.norm(np.diff(found, axis=0), axis=1).sum())
    return Line({"chain": told} | text, _even(found, pieces), np.zeros(3), length, (first, tangent), halved=False)


def _unit(rng: np.random.Generator) -> Array:
    way = rng.normal(size=3)
    return way / np.linalg.norm(way)
