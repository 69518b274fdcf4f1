"""Section functions with denser control points on a part of the surface, as under a contact.

The circle is cut in equal fine arcs, and each arc of these functions is a row of them.  On an arc they are combinations
of ``1, cos, sin``, and their slopes are continuous: combinations of the boundary functions of the fine arcs
(`isorod.geometry.disk`) that are smooth at the joints left out.  Their harmonic extensions ``T_i`` and
``(1 - s)^k T_i``, ``s = |xi|^2``, ``k < K``, span polyharmonic functions, as in `isorod.space.polyharmonic`.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isorod.arrays import Array
from isorod.errors import Checked, InputError
from isorod.geometry.disk import check_count, control_points, harmonic_functions
from isorod.geometry.quadrature import Rule, graded_points
from isorod.geometry.section import refine, refinement_turn
from isorod.space.basis import family_of
from isorod.space.polyharmonic import zernike

# Polyharmonic order.  Under a small patch waves that are long round the section are short along the axis, and decay
# towards the inside over that length; with an order of 2 crossing cylinders are 4 % too stiff on each other, with 3
# 1 %.
ORDER = 3


@dataclass(frozen=True, eq=False)
class Graded(Checked):
    """Polyharmonic functions of unevenly spaced control points, those of the ``T_i``, which come first.

    Parameters
    ----------
    n
        Number of control points of the rod's own sections.
    arcs
        Numbers of fine arcs in each arc, in order round the section from the beginning of the rod's first arc on; no
        arc crosses the end of one of the rod's.
    order
        Polyharmonic order ``K``.

    Raises
    ------
    InputError
        If the fine arcs do not add up to a multiple of the rod's, or an arc crosses the end of one of these.
    """

    n: int
    arcs: tuple[int, ...]
    order: int = ORDER

    on_surface: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        ends = np.cumsum(self.arcs)
        fine = check_count(int(ends[-1])) if len(self.arcs) else 0
        if min(self.arcs, default=0) < 1 or fine % self.n:
            raise InputError(f"arcs: got {fine} fine ones, need a multiple of the {self.n} arcs of the rod itself")
        if not np.isin(np.arange(1, self.n + 1) * (fine // self.n), ends).all():
            raise InputError(f"arcs: one crosses the end of one of the {self.n} arcs of the rod itself")

    def __str__(self) -> str:
        return f"{self.family}, order {self.order} of {len(self.arcs)} control points, refined at a patch"

    @property
    def family(self) -> str:
        """The family of elements that they make."""
        return family_of(self.order)

    @property
    def fine(self) -> int:
        """Number of fine arcs round the section."""
        return sum(self.arcs)

    @property
    def turn(self) -> float:
        """Angle of the first fine control point, radians."""
        return refinement_turn(self.n, self.fine // self.n)

    @property
    def joints(self) -> Array:
        """Angles at which arcs begin, and at which the last one ends, shape ``(arcs + 1,)``, radians."""
        ends = np.concatenate([[0], np.cumsum(self.arcs)])
        return self.turn + 2.0 * np.pi / self.fine * (ends - 0.5)

    @cached_property
    def among_fine(self) -> Array:
        """Each function as a sum of those of the fine arcs, shape ``(fine, arcs)``.

        Control points of a circle are where tangents at neighbouring joints meet.  A function is linear on the plane of
        an arc; at a joint, the point of contact of the tangent, it is interpolated between the control points on either
        side; the fine control points lie in the same plane.
        """
        joints, count = self.joints, len(self.arcs)
        half = 0.5 * np.diff(joints)
        middle = 0.5 * (joints[1:] + joints[:-1])
        place = np.stack([np.cos(middle), np.sin(middle)], axis=1) / np.cos(half)[:, None]
        lengths = np.tan(half)
        begin = np.zeros((count, count))
        rows, before = np.arange(count), np.arange(count) - 1
        begin[rows, rows] = lengths[before] / (lengths[before] + lengths)
        begin[rows, before] = lengths / (lengths[before] + lengths)
        end = np.roll(begin, -1, axis=0)
        fine = control_points(self.fine) @ _turned(self.turn)
        result, first = [], 0
        for k, parts in enumerate(self.arcs):
            angles = joints[[k, k + 1]]
            corners = np.array(
                [[np.cos(angles[0]), np.sin(angles[0])], place[k], [np.cos(angles[1]), np.sin(angles[1])]]
            )
            coordinates = np.linalg.solve(_lifted(corners).T, _lifted(fine[first : first + parts]).T).T
            result.append(coordinates @ np.stack([begin[k], np.eye(count)[k], end[k]]))
            first += parts
        return np.concatenate(result)

    @property
    def count(self) -> int:
        """Number of functions."""
        return self.order * len(self.arcs)

    def finer(self) -> "Graded":
        """Return functions with the shortest arcs halved, which contain these."""
        least = min(self.arcs)
        return replace(self, arcs=tuple(part for n in self.arcs for part in ((n, n) if n == least else (2 * n,))))

    @property
    def is_control_point(self) -> NDArray[np.bool_]:
        """Whether a function is of a control point, shape ``(count,)``."""
        return np.arange(self.count) < len(self.arcs)

    def functions(self, xi: ArrayLike) -> tuple[Array, Array]:
        """Return values ``(m, count)`` and gradients ``(m, count, 2)`` at points of the closed disk ``(m, 2)``."""
        points = np.asarray(xi, dtype=float).reshape(-1, 2)
        forth = _turned(self.turn)
        fine, slopes = harmonic_functions(self.fine, points @ forth.T)
        values = fine @ self.among_fine
        gradients = np.einsum("qib,ij->qjb", slopes, self.among_fine, optimize=True) @ forth
        rest = 1.0 - np.sum(points**2, axis=1)
        powers = [(values, gradients)]
        for _ in range(self.order - 1):
            value, slope = powers[-1]
            inner = rest[:, None, None] * slope - 2.0 * value[:, :, None] * points[:, None, :]
            powers.append((rest[:, None] * value, inner))
        return np.concatenate([array for array, _ in powers], axis=1), np.concatenate(
            [array for _, array in powers], axis=1
        )

    def positions(self, polygons: Array) -> Array:
        """Return coefficients ``(layers, count, 3)`` of the map of the rod's control points ``(layers, n, 3)``."""
        layers = polygons.shape[0]
        fine = refine(polygons.swapaxes(0, 1), self.fine // self.n).reshape(self.fine, -1)
        result = np.zeros((layers, self.count, 3))
        coefficients = np.linalg.lstsq(self.among_fine, fine, rcond=None)[0]
        result[:, : len(self.arcs)] = coefficients.reshape(-1, layers, 3).swapaxes(0, 1)
        return result

    def points(self, rule: Rule) -> tuple[Array, Array]:
        """Return points of the disk and weights of a rule (`isorod.geometry.quadrature.graded_points`)."""
        return graded_points(self.joints, rule)

    def auto(self, degree: int) -> Rule:
        """Return ``(K + 2) x 2 x (p + 1)``, in each ring of a slice."""
        return Rule(self.order + 2, 2, degree + 1)

    def full(self, degree: int) -> Rule:
        """Return a rule with more points."""
        return Rule(self.auto(degree).radial + 2, 4, degree + 2)

    @property
    def pressure_count(self) -> int:
        """Number of section functions of pressures, `pressures`."""
        return self.pressures([[0.0, 0.0]]).shape[1]

    def pressures(self, xi: ArrayLike) -> Array:
        """Return polyharmonic functions of one order less, and polynomials of degree ``K``.

        The former, ``(1 - s)^k T_i``, contain the latter except ``s`` for order 2.
        """
        points = np.asarray(xi, dtype=float).reshape(-1, 2)
        if self.order == 1:
            return zernike(points, [(0, 0), (1, 0)])
        values = self.functions(points)[0][:, : (self.order - 1) * len(self.arcs)]
        if self.order == 2:
            values = np.column_stack([values, 1.0 - np.sum(points**2, axis=1)])
        return np.ascontiguousarray(values)


def _turned(angle: float) -> Array:
    """Return the matrix that turns rows by an angle, radians."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, sin], [-sin, cos]])


def _lifted(points: Array) -> Array:
    """Return ``(x, y, 1)`` of points ``(m, 2)``."""
    return np.column_stack([points, np.ones(len(points))])
