"""The geometry of a rod: disk x axis, ``x(xi, u) = sum_ij T_i(xi) R_j(u) P_ij`` (Lu & Zhou 2011, eqs. 11-13)."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.errors import Checked, FoldedRodError, InputError, numbers
from isorod.geometry import fold
from isorod.geometry.axis import Axis
from isorod.geometry.disk import check_count, circle, harmonic_functions
from isorod.geometry.fitting import evaluate
from isorod.geometry.frames import ArcLength
from isorod.geometry.quadrature import WHOLE, Rule, axis_points, section_points
from isorod.geometry.reading import EXACT, Deviation
from isorod.tensors import determinant

# Size of sections between layers of control points, relative to the smallest of these, below which there is a warning,
# and an error. Layers that turn by 45 degrees over a quadratic element leave 96 %, by 90 degrees 85 %, by 180 degrees
# half.
_SHRINKS = 0.95
_SHRUNK = 0.7

# The thinnest ring of a section, relative to its radius.
_THINNEST = 1e-3

# Largest length in radii: axial and bending stiffness differ by the square of that.
_MOST_SLENDER = float(np.finfo(float).eps ** -0.5)

# Most points round the circle at which folds are searched, with eight an arc.
_AROUND = 1024

# The smallest radius of a hole, or of a core: 1 / r^2 is among the functions of such sections.
_INNERMOST = 0.02


@dataclass(frozen=True, eq=False)
class Rod(Checked):
    """A rod given by control points on its surface only.

    Parameters
    ----------
    axis
        NURBS basis along the rod.
    control_points
        Shape ``(layers, n, 3)`` in units of length: layer ``j`` belongs to axis function ``j``, point ``i`` to ``T_i``.
    closed
        True if the first and the last layer are the same (a ring).
    fitted
        True if the sizes given are those of sections, not of layers of control points.
    rings
        Radii on the disk, from the inside, between which the section's rings lie: ``(0, 1)`` is solid, ``(0.5, 1)`` a
        tube, ``(0, 0.8, 1)`` a core with a sheath.
    deviation
        Its deviation from the input (`isorod.geometry.reading.Deviation`).

    Raises
    ------
    InputError
        If shapes do not fit, a value is not finite, a closed rod's end layers differ, or radii do not rise to 1.
    """

    axis: Axis
    control_points: Array
    closed: bool = False
    fitted: bool = False
    rings: tuple[float, ...] = WHOLE
    deviation: Deviation = EXACT

    def __post_init__(self) -> None:
        super().__post_init__()
        points = np.array(self.control_points, dtype=float)
        self._set(control_points=points, rings=tuple(float(radius) for radius in self.rings))
        if points.ndim != 3 or points.shape[0] != self.axis.count or points.shape[2] != 3:
            raise InputError(
                f"rod control points: got shape {points.shape}, need ({self.axis.count}, n, 3) for this axis"
            )
        check_count(points.shape[1])
        bad = ~np.isfinite(points).all(axis=2)
        if bad.any():
            j, i = np.argwhere(bad)[0]
            raise InputError(f"rod control point {i} of layer {j} is not finite")
        if self.closed and not np.array_equal(points[0], points[-1]):
            raise InputError("closed rod: the last layer of control points must repeat the first")
        thinnest = np.diff(self.rings).min(initial=np.inf if len(self.rings) > 1 else 0.0)
        innermost = min((radius for radius in self.rings if radius != 0.0), default=0.0)
        if not (thinnest >= _THINNEST and innermost >= _INNERMOST and self.rings[-1] == 1.0):
            raise InputError(
                f"rings: got radii {', '.join(f'{radius:g}' for radius in self.rings)}; need some that rise from 0, or "
                f"that of a hole, to 1, by {_THINNEST:g} or more each, the first of them {_INNERMOST:g} or more"
            )

    def __repr__(self) -> str:
        layers, n, _ = self.control_points.shape
        rings = "" if self.rings == WHOLE else f", rings {' '.join(f'{radius:g}' for radius in self.rings)}"
        return f"Rod({layers} layers of {n} control points{', closed' if self.closed else ''}{rings}; {self.axis!r})"

    @property
    def section_points(self) -> int:
        """Number of control points round the section, ``n``."""
        return self.control_points.shape[1]

    @cached_property
    def radius(self) -> float:
        """Largest distance of a section's control points from their centre, units of length."""
        centers = self.control_points.mean(axis=1)
        return float(np.linalg.norm(self.control_points - centers[:, None], axis=2).max())

    @cached_property
    def slenderness(self) -> float:
        """Length of the polygon of the sections' centres over `radius`."""
        centers = self.control_points.mean(axis=1)
        length = float(np.linalg.norm(np.diff(centers, axis=0), axis=1).sum())
        # Squares of the smallest radii are zero.
        return length / self.radius if self.radius else np.inf

    def radii(self, u: ArrayLike, points: int) -> tuple[Array, Array]:
        """Return mean and largest distance of so many points of the outline from their centre, ``(t,)`` each."""
        outline = self.grid(circle(points), u)[0]
        spokes = np.linalg.norm(outline - outline.mean(axis=1, keepdims=True), axis=2)
        return spokes.mean(axis=1), spokes.max(axis=1)

    @property
    def distinct_control_points(self) -> int:
        """Number of control points, the shared layer of a closed rod counted once."""
        return (self.axis.count - self.closed) * self.section_points

    @classmethod
    def sweep(
        cls,
        section: ArrayLike,
        axis: Axis,
        centers: ArrayLike,
        rotations: ArrayLike | None = None,
        stretches: ArrayLike | None = None,
        closed: bool = False,
    ) -> "Rod":
        """Sweep a section along control points of the centre line: ``P_ij = C_j + R_j S_j P_i`` (eq. 13).

        Parameters
        ----------
        section
            Control polygon, shape ``(n, 2)``; its plane is spanned by the first two columns of ``R_j``.
        centers
            Control points of the centre line, shape ``(layers, 3)``.
        rotations, stretches
            Tensors of shape ``(layers, 3, 3)``; identity where not given.
        """
        section, centers = numbers("section", section), numbers("centre line", centers)
        if section.ndim != 2 or section.shape[1] != 2:
            raise InputError(f"section: got shape {section.shape}, need (n, 2)")
        if centers.shape != (axis.count, 3):
            raise InputError(f"centre line: got shape {centers.shape}, need ({axis.count}, 3) for this axis")
        shape = (axis.count, 3, 3)
        turn = np.broadcast_to(np.eye(3), shape) if rotations is None else np.asarray(rotations, dtype=float)
        stretch = np.broadcast_to(np.eye(3), shape) if stretches is None else np.asarray(stretches, dtype=float)
        for name, tensors in (("rotations", turn), ("stretches", stretch)):
            if tensors.shape != shape:
                raise InputError(f"{name}: got shape {tensors.shape}, need {shape} for this axis")
        points = centers[:, None, :] + section @ (turn @ stretch)[:, :, :2].swapaxes(1, 2)
        return cls(axis, closing(points) if closed else points, closed)

    def refine(self, parts: int = 1, degree: int | None = None, continuity: int | None = None) -> "Rod":
        """Return the same rod with more control points (see `Axis.refine`)."""
        return self._on(self.axis.refine(parts, degree, continuity))

    def insert(self, u: float, multiplicity: int = 1) -> "Rod":
        """Return the same rod with an axis knot inserted."""
        return self._on(self.axis.insert(u, multiplicity))

    def _on(self, axis: Axis) -> "Rod":
        points = self.axis.transfer(axis, self.control_points)
        if self.closed:
            points[-1] = points[0]
        return replace(self, axis=axis, control_points=points)

    def with_rings(self, rings: Sequence[float]) -> "Rod":
        """Return the rod with a hole or in layers: radii of its rings relative to the outer one, from the inside.

        ``(0.5, 1)`` is a tube, ``(0, 0.8, 1)`` a core with a sheath.  Where the section is not round, radii are those
        of the disk, whose circles are mapped to curves similar to the outline.
        """
        return replace(self, rings=tuple(rings))

    def points(self, xi: ArrayLike, u: ArrayLike) -> Array:
        """Return the positions ``(m, 3)`` of the parameter pairs ``xi`` ``(m, 2)`` and ``u`` ``(m,)``."""
        values, _ = harmonic_functions(self.section_points, xi)
        section, _ = self._sections(u)
        return np.einsum("mi,mia->ma", values, section)

    def grid(self, xi: ArrayLike, u: ArrayLike) -> tuple[Array, Array]:
        """Return positions ``(t, q, 3)`` and Jacobians ``dx/d(xi_1, xi_2, u)`` ``(t, q, 3, 3)`` at all pairs."""
        values, gradients = harmonic_functions(self.section_points, xi)
        section, along = self._sections(u)
        return values @ section, section_gradient(values, gradients, section, along)

    def across(self, xi: ArrayLike, u: ArrayLike) -> tuple[Array, Array]:
        """Return positions ``(..., 3)`` and derivatives ``dx/d(xi_1, xi_2)`` ``(..., 3, 2)`` at any points.

        Parameters
        ----------
        xi, u
            Shapes ``(..., 2)`` and ``(...)``, which broadcast.
        """
        points, parameters = np.asarray(xi, dtype=float), np.asarray(u, dtype=float)
        values, gradients = harmonic_functions(self.section_points, points)
        section = self._sections(parameters.ravel())[0].reshape(*parameters.shape, self.section_points, 3)
        values, gradients = values.reshape(*points.shape[:-1], -1), gradients.reshape(*points.shape[:-1], -1, 2)
        position = np.einsum("...i,...ia->...a", values, section)
        return position, np.einsum("...id,...ia->...ad", gradients, section)

    def inverse_jacobians(self, xi: ArrayLike, u: ArrayLike) -> tuple[Array, Array]:
        """Return ``d(xi_1, xi_2, u)/dx`` ``(t, q, 3, 3)`` and Jacobian determinants ``(t, q)`` at all pairs."""
        # Imported late: geometry alone needs no compiled code.
        from isorod.geometry import jacobian_kernel

        values, gradients = harmonic_functions(self.section_points, xi)
        section, along = self._sections(u)
        inverse = np.empty((section.shape[0], values.shape[0], 3, 3))
        det = np.empty(inverse.shape[:2])
        polygons, slopes = (field.swapaxes(0, 1).reshape(values.shape[1], -1) for field in (section, along))
        columns = gradients[:, :, 0] @ polygons, gradients[:, :, 1] @ polygons, values @ slopes
        jacobian_kernel.inverse_jacobians(*columns, inverse, det)
        return inverse, det

    @cached_property
    def arc_length(self) -> ArcLength:
        """The length of the centre line, the image of the disk's centre, up to axis parameters."""
        # At the centre every harmonic function is 1 / n.
        return ArcLength(self.axis, self.control_points.mean(axis=1))

    def tangents(self, u: ArrayLike) -> Array:
        """Return the unit tangents ``(len(u), 3)`` of the centre line, the image of the disk's centre."""
        # At the centre every harmonic function is 1 / n.
        along = self._sections(u)[1].mean(axis=1)
        return along / np.linalg.norm(along, axis=1, keepdims=True)

    def _sections(self, u: ArrayLike) -> tuple[Array, Array]:
        """Return the control polygons ``(len(u), n, 3)`` of the sections at ``u``, and their derivatives."""
        return evaluate(self.axis, self.control_points, np.asarray(u))

    def volume(self) -> float:
        """Return the volume (length cubed), by a full quadrature rule."""
        rule = Rule.full(self.section_points, self.axis.degree + 2)
        xi, area = section_points(self.section_points, rule, rings=self.rings)
        u, length = axis_points(self.axis, rule.axial)
        _, jacobian = self.grid(xi, u.ravel())
        return float(np.einsum("tq,t,q->", determinant(jacobian), length.ravel(), area))

    def check(self) -> float:
        """Return the smallest Jacobian determinant on a dense grid, circle and element ends included.

        Raises
        ------
        InputError
            Where the rod is so slender that its bending stiffness is round-off beside that along it.
        FoldedRodError
            Where the map folds (determinant not positive): the message names element, ``u``, disk point, position and
            cause (`isorod.geometry.fold`).
        """
        with np.errstate(over="ignore", invalid="ignore"):
            slenderness = self.slenderness
        if not slenderness <= _MOST_SLENDER:
            raise InputError(
                f"rod: {slenderness:.3g} radii long, need at most {_MOST_SLENDER:.2g}: its bending stiffness is the "
                "round-off of that along it"
            )
        axis = self.axis
        xi, values, across = _dense_grid(self.section_points)
        inside = np.arange(axis.degree + 3) / (axis.degree + 2)
        # Both sides of every knot: the axis may have a kink there.
        inside[0], inside[-1] = 1e-9, 1.0 - 1e-9
        u = axis.within(inside)
        section, along = self._sections(u.ravel())
        # Component by component: no array of Jacobian matrices is needed.
        polygons, turns = (np.ascontiguousarray(np.moveaxis(field, 2, 0)) for field in (section, along))
        (a, b, c), (d, e, f) = (polygons @ slope for slope in across)
        g, h, i = turns @ values
        det = g * (b * f - c * e) + h * (c * d - a * f) + i * (a * e - b * d)
        t, q = np.unravel_index(int(np.argmin(det)), det.shape)
        if not det[t, q] > 0.0:
            where = ", ".join(f"{value:.4g}" for value in values[:, q] @ section[t])
            raise FoldedRodError(
                f"the rod folds in element {t // inside.size} at u = {u.ravel()[t]:.4g}, disk point "
                f"({xi[q, 0]:.3f}, {xi[q, 1]:.3f}), position ({where}): Jacobian determinant {det[t, q]:.3g}, must be "
                f"positive; {fold.reason(self._sections, u, int(t), xi[q])}"
            )
        if not self.fitted:
            self._check_turns(u, section)
        return float(det[t, q])

    def _check_turns(self, u: Array, section: Array) -> None:
        """Raise or warn where sections, polygons at parameters ``u``, shrink between layers that turn too far."""

        def sizes(polygons: Array) -> Array:
            arms = polygons - polygons.mean(axis=1, keepdims=True)
            size: Array = np.sqrt(np.einsum("jia,jia->j", arms, arms))
            return size

        axis = self.axis
        extents = sizes(np.concatenate([self.control_points, section]))
        near = axis.first_function[:, None] + np.arange(axis.degree + 1)
        ratios = extents[axis.count :].reshape(u.shape) / extents[near].min(axis=1)[:, None]
        e, t = np.unravel_index(int(np.argmin(ratios)), ratios.shape)
        if ratios[e, t] < _SHRINKS:
            text = (
                f"element {e} at u = {u[e, t]:.4g}: the section shrinks to {100 * ratios[e, t]:.0f} % between layers "
                "of control points, which turn too far; take more elements"
            )
            if ratios[e, t] < _SHRUNK:
                raise FoldedRodError(text)
            warnings.warn(text, stacklevel=3)


def closing(points: Array) -> Array:
    """Return layers of control points with the last, which must coincide with the first, exactly equal to it."""
    gap = np.abs(points[-1] - points[0]).max()
    if not gap <= 1e-9 * np.abs(points).max():
        raise InputError(f"closed rod: the last section is {gap:.3g} away from the first; they must coincide")
    return np.concatenate([points[:-1], points[:1]])


@lru_cache(maxsize=8)
def _dense_grid(n: int) -> tuple[Array, Array, tuple[Array, Array]]:
    """Return points of the disk ``(m, 2)``, circle included, the harmonic functions and their slopes ``(n, m)``."""
    radii = np.array([0.25, 0.5, 0.75, 0.9, 1.0])
    # Eight an arc; two where there are so many arcs that the functions at all points would fill the memory.
    around = max(min(8 * n, _AROUND), 2 * n)
    xi = np.concatenate([[[0.0, 0.0]], (radii[:, None, None] * circle(around)).reshape(-1, 2)])
    values, gradients = harmonic_functions(n, xi)
    first, second = (np.ascontiguousarray(gradients[:, :, k].T) for k in range(2))
    return xi, np.ascontiguousarray(values.T), (first, second)


def section_gradient(values: Array, gradients: Array, section: Array, along: Array) -> Array:
    """Return the derivatives by ``xi_1, xi_2, u`` of a field on a grid, shape ``(t, q, components, 3)``.

    ``values`` ``(q, n)`` and ``gradients`` ``(q, n, 2)`` are the section functions; ``section`` and ``along`` ``(t, n,
    components)`` the field's section coefficients and their derivatives by ``u``.
    """
    q, n, _ = gradients.shape
    plane = gradients.transpose(0, 2, 1).reshape(2 * q, n) @ section
    result = np.empty((section.shape[0], q, section.shape[2], 3))
    result[..., :2] = plane.reshape(-1, q, 2, section.shape[2]).swapaxes(2, 3)
    result[..., 2] = values @ along
    return result
