"""Quadrilateral templates of flat sections that are laid out in space: grids whose lines cross the section straight.

Near a sharp edge the harmonic map bends lines that cross the disk straight by more than the section is thick there.  So
nodes are put where they belong in a plane section, and the map is inverted.  The torsion of an airfoil with a sharp
edge is right to 8e-4 with six quadrilaterals of order 2; with an O-grid of twelve it is off by 1.4e-2.
"""

from collections.abc import Callable

import numpy as np

from isorod.errors import InputError
from isorod.geometry.rod import Rod
from meshes.mesh import Array
from meshes.strip import grid
from meshes.template import Template

# Positions (m, 2) in the plane of a section of points (m, 2) of the disk, and their derivatives (m, 2, 2).
Plane = Callable[[Array], tuple[Array, Array]]

# Points of the outline that are looked at.
_AROUND = 2880

# A tip is in the middle of the points less than this fraction of the section's length from its end.
_TIP = 2e-3

# The most curved point is searched in this fraction of its length.
_NOSE = 0.1

# Angles this near to each other are the same, radians.
_SAME = 0.01

# Accuracy of a node's place, a fraction of the section's length; steps of the search, and halvings of a step.
_NEAR = 1e-12
_STEPS = 25
_HALVINGS = 8


def circle(angle: Array) -> Array:
    """Return the points ``(m, 2)`` of the unit circle at angles in radians."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def plane(rod: Rod, u: float, radius: float = 1.0) -> Plane:
    """Return the section at ``u`` inside of a radius of its disk, turned such that it is longest along x."""
    rim, _ = rod.grid(radius * circle(2.0 * np.pi * np.arange(_AROUND) / _AROUND), [u])
    middle = rim[0].mean(axis=0)
    directions = np.linalg.svd(rim[0] - middle, full_matrices=False)[2][:2]
    # The sense of rotation of the disk, as seen along the rod, is kept.
    if np.dot(np.cross(*directions), rod.tangents([u])[0]) < 0.0:
        directions[1] *= -1.0

    def at(xi: Array) -> tuple[Array, Array]:
        positions, jacobian = rod.grid(radius * xi, [u])
        return (positions[0] - middle) @ directions.T, radius * directions @ jacobian[0, :, :, :2]

    return at


def tips(section: Plane) -> list[tuple[float, float]]:
    """Return the angles on the disk of the two ends of a section along x, radians, the second the greater one.

    They are those of the outermost points, or of the most curved ones near these, or amid both.
    """
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    z = section(circle(angle))[0] @ np.array([1.0, 1j])
    ahead, behind = np.roll(z, -1) - z, z - np.roll(z, 1)
    turn = np.angle(ahead / behind) / np.abs(ahead + behind)
    tips = []
    for short in (z.real.max() - z.real, z.real - z.real.min()):
        outermost = angle[short < _TIP * np.ptp(z.real)]
        first = np.exp(1j * outermost).mean()
        curved = np.exp(1j * angle[np.argmax(np.where(short < _NOSE * np.ptp(z.real), turn, -np.inf))])
        tips.append([float(np.angle(one)) for one in (first, first + curved, curved)])
    pairs = [(first, first + (second - first) % (2.0 * np.pi)) for first, second in zip(*tips, strict=True)]
    return [pair for k, pair in enumerate(pairs) if not any(np.allclose(pair, one, atol=_SAME) for one in pairs[:k])]


def laid_out(
    section: Plane,
    ends: tuple[float, float],
    along: int,
    across: int,
    order: int,
    corners: tuple[float, float],
    power: float = 1.0,
) -> Template:
    """Return a grid of ``along x across`` quadrilaterals between the two sides of a section.

    Parameters
    ----------
    section
        The plane section.
    ends
        Angles of its tips on the disk, radians, the second the greater one (`tips`).
    along, across
        Numbers of quadrilaterals from one end of the section to the other, and from side to side.
    order
        Polynomial order, 1 to 4.
    corners
        Angles on the disk between the tips and the corners of the grid, degrees.
    power
        Nodes go away from a corner as this power, 1 or less, of their number: below 1 the edges that meet there, which
        the smooth outline continues in one line, start into the section on every level, and no corner is inverted.

    Raises
    ------
    InputError
        If the search of a node's place fails: the section is one that straight lines do not cross.
    """
    (first, second), (a, b) = ends, np.radians(corners)
    s, t = (np.arange(order * count + 1) / (order * count) for count in (along, across))
    s, t = (one**power / (one**power + (1.0 - one) ** power) for one in (s, t))
    sides = (
        first + a + s * (second - b - first - a),
        first - a - s * (first - a - second - b + 2.0 * np.pi),
        first + a - 2.0 * a * t,
        second - b + 2.0 * b * t,
    )
    disk = _between([circle(side) for side in sides], s, t)
    inside = disk[1:-1, 1:-1]
    if inside.size:
        targets = _between([section(circle(side))[0] for side in sides], s, t)[1:-1, 1:-1]
        inside[:] = _inverse(section, inside.reshape(-1, 2), targets.reshape(-1, 2)).reshape(inside.shape)
    return grid(disk, order)


def _between(sides: list[Array], s: Array, t: Array) -> Array:
    """Return the grid ``(t, s, 2)`` between two sides ``(s, 2)`` and two ends ``(t, 2)``: transfinite interpolation."""
    one, other, start, end = sides
    s, t = s[:, None], t[:, None, None]
    ruled = (1.0 - t) * one + t * other
    corners = (1.0 - s) * ruled[:, :1] + s * ruled[:, -1:]
    return ruled + (1.0 - s) * start[:, None] + s * end[:, None] - corners


def _inverse(section: Plane, start: Array, targets: Array) -> Array:
    """Return the points of the disk that stand at places ``(m, 2)``, by Newton's method, damped."""
    xi, length = start, np.ptp(targets, axis=0).max()
    places, slopes = section(xi)
    for _ in range(_STEPS):
        short = targets - places
        gap = np.linalg.norm(short, axis=1)
        if gap.max() <= _NEAR * length:
            return xi
        step = np.linalg.solve(slopes, short[..., None])[..., 0]
        for _ in range(_HALVINGS):
            new = xi + step
            outside = np.linalg.norm(new, axis=1) >= 1.0
            new[outside] = xi[outside]
            places, slopes = section(new)
            worse = outside | (np.linalg.norm(targets - places, axis=1) > gap + _NEAR * length)
            if not worse.any():
                break
            step[worse] *= 0.5
        else:
            break
        xi = new
    raise InputError("mesh: the section is not crossed by straight lines from side to side")
