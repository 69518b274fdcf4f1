"""Curves and fields in the space of an axis: interpolation, least squares, and adaptive refinement."""

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_banded

from isorod.arrays import Array, Index
from isorod.choices import chosen
from isorod.errors import InputError
from isorod.geometry import bspline
from isorod.geometry.axis import MAX_ELEMENTS, Axis

Field = Callable[[Array], Array]

# A field is measured at this many points of an element for each degree of the axis.
_POINTS = 4
_ROUNDS = 12


def evaluate(axis: Axis, coefficients: Array, u: Array) -> tuple[Array, Array]:
    """Return a field ``(t, ...)`` of coefficients ``(axis.count, ...)`` and its derivative by the parameter."""
    first, values, slopes = axis.local(u)
    near = coefficients[first[:, None] + np.arange(axis.degree + 1)]
    return np.einsum("tj,tj...->t...", values, near), np.einsum("tj,tj...->t...", slopes, near)


def inside(axis: Axis, count: int) -> Array:
    """Return ``count`` evenly spaced parameters of every element, without its ends, shape ``(elements, count)``."""
    return axis.within(np.arange(1.0, count + 1.0) / (count + 1.0))


def interpolate(axis: Axis, field: Field) -> Array:
    """Return the coefficients ``(axis.count, ...)`` that interpolate a field at the Greville points of the axis."""
    points = bspline.greville(axis.knots, axis.degree)
    target = field(points)
    first, values, _ = axis.local(points)
    p, row = axis.degree, np.arange(axis.count)[:, None]
    column = first[:, None] + np.arange(p + 1)
    band = np.zeros((2 * p + 1, axis.count))
    band[p + row - column, column] = values
    result: Array = solve_banded((p, p), band, target.reshape(axis.count, -1))
    return result.reshape(target.shape)


def resolve(axis: Axis, field: Field, tolerance: float) -> tuple[Axis, Array, float]:
    """Return the axis refined as a field needs, the field's coefficients there, and the largest error.

    Parameters
    ----------
    axis
        The initial axis, whose space is contained in that of the result.
    field
        Of parameters ``(t,)``, shape ``(t, ..., 3)``: vectors, continuous.
    tolerance
        Largest error of the vectors, in their unit.

    Raises
    ------
    InputError
        If no number of knots suffices: the field jumps.
    """
    power = 1.0 / (axis.degree + 1)

    def more() -> Index | None:
        """Return the numbers of parts of elements, None where the field is within the tolerance."""
        if errors.max() <= tolerance:
            return None
        # The error falls with that power of the element's length.
        return np.clip(np.ceil(1.05 * (errors / tolerance) ** power), 1, 4).astype(int)

    for _ in range(_ROUNDS):
        fit = np.sort(np.concatenate([inside(axis, 2 * axis.degree).ravel(), axis.breaks]))
        target = field(fit)
        # Interpolation would make circles too small everywhere: its error is one-sided.
        coefficients = nearest(axis, fit, target.reshape(fit.size, -1)).reshape(axis.count, *target.shape[1:])
        u = inside(axis, _POINTS * axis.degree)
        off = evaluate(axis, coefficients, u.ravel())[0] - field(u.ravel())
        errors = np.linalg.norm(off, axis=-1).reshape(axis.elements, -1).max(axis=1)
        parts = chosen(more)
        if parts is None:
            return axis, coefficients, float(errors.max())
        if parts.sum() > MAX_ELEMENTS // 10:
            break
        axis = axis.cut(parts)
    worst = int(np.argmax(errors))
    raise InputError(
        f"sweep: at u = {axis.breaks[worst]:.4g} sections are {errors.max():.3g} off and more elements do not help; "
        "frame and scale must be continuous"
    )


def least_squares(functions: Index, values: Array, points: Array, count: int) -> Array:
    """Return the coefficients ``(count, c)`` of the curve nearest to points.

    Parameters
    ----------
    functions, values
        Numbers of the functions at each point's parameter, and their values, both ``(t, p + 1)``; those numbered below
        0 or from ``count`` on are left out.
    points
        Shape ``(t, c)``.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the points do not determine it.
    """
    # Imported late: straight lines and arcs do not need it.
    from scipy.sparse import csr_matrix
    from scipy.sparse.linalg import splu

    rows = np.broadcast_to(np.arange(points.shape[0])[:, None], functions.shape)
    there = (functions >= 0) & (functions < count)
    matrix = csr_matrix((values[there], (rows[there], functions[there])), shape=(points.shape[0], count))
    try:
        result: Array = splu((matrix.T @ matrix).tocsc()).solve(matrix.T @ points)
    except RuntimeError as error:
        raise np.linalg.LinAlgError("the points do not determine the curve") from error
    return result


def nearest(axis: Axis, u: Array, points: Array, slopes: Array | None = None) -> Array:
    """Return the coefficients ``(axis.count, c)`` of the curve nearest to points, through the first and the last.

    Parameters
    ----------
    u
        Ascending parameters of the points ``(t,)``, the first and the last those of the axis.
    points
        Shape ``(t, c)``.
    slopes
        Its derivatives at both ends, ``(2, c)``, if these are prescribed; the axis has no weights then.
    """
    p = axis.degree
    first, values, _ = axis.local(u)
    functions = first[:, None] + np.arange(p + 1)
    fixed = np.zeros((axis.count, points.shape[1]))
    fixed[0], fixed[-1] = points[0], points[-1]
    held = 1
    if slopes is not None:
        held, ends = 2, axis.knots[[p + 1, -1]] - axis.knots[[0, -p - 2]]
        fixed[1] = points[0] + ends[0] / p * slopes[0]
        fixed[-2] = points[-1] - ends[1] / p * slopes[1]
    rest = points - np.einsum("tj,tjc->tc", values, fixed[functions])
    fixed[held:-held] = least_squares(functions - held, values, rest, axis.count - 2 * held)
    return fixed
