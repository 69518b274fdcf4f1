"""What a file asks of a contact: its force and moment, and the patch on the rods of its first side."""

import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.files.measures import Axis, Component, Point, along, component_of, refuse_others

if TYPE_CHECKING:
    from isorod.contact.result import ContactResult
    from isorod.dynamics.history import History
    from isorod.model.model import Model
    from isorod.statics.analysis import Equilibrium

Patch = Literal["area", "length", "width", "pressure", "places"]

# Relative error from which a measure of a contact is warned of.
_LARGE = 0.005


def contact_force(solution: "Equilibrium", contact: int, component: Component | None = None) -> float:
    """Return the total normal force of a contact, or a component of what its second side exerts on its first.

    In statics alone; a motion's record has the normal force of all contacts.

    Parameters
    ----------
    contact
        Which one.
    component
        ``"x"``, ``"y"`` or ``"z"`` of the resultant on the first side, friction too; where not given the integral of
        the pressure.
    """
    if component is None:
        return float(solution.contacts[contact].force)
    return float(component_of(_pushes(solution, contact)[1].sum(axis=0), component))


def contact_moment(
    solution: "Equilibrium",
    contact: int,
    component: Component | None = None,
    point: Point = (0.0, 0.0, 0.0),
    about: Axis | None = None,
) -> Any:
    """Return the moment of a contact's second side, such as an obstacle, on its first (statics alone).

    Parameters
    ----------
    contact
        Which one.
    component
        ``"x"``, ``"y"`` or ``"z"``; all three where not given.
    point
        About which it is.
    about
        An axis through that point, by its letter or a vector of any length: the moment about it alone.
    """
    places, forces = _pushes(solution, contact)
    return along(np.cross(places - np.array(point), forces).sum(axis=0), component, about)


def contact_patch(solution: "Equilibrium", contact: int, component: Patch = "area") -> float:
    """Return how large the patch of a contact is on the rods of its first side (statics alone).

    Parameters
    ----------
    contact
        Which one.
    component
        ``"area"``, at rest; ``"length"`` along a rod and ``"width"`` round it, of the largest place; ``"pressure"``,
        the largest, force per area at rest; ``"places"``, the number of places of contact apart from each other.
    """
    refuse_others(solution, "contact_patch")
    return _patch(solution.model, contact, solution.contacts[contact], component)


def obstacle_force(
    solution: "Equilibrium | History", obstacle: tuple[int, ...], component: Component | None = None
) -> Any:
    """Return the force of a rigid obstacle on the rods, friction included, or one component of it.

    Parameters
    ----------
    obstacle
        Which one.
    component
        ``"x"``, ``"y"`` or ``"z"``; all three where not given.
    """
    return component_of(_of_obstacle(solution, obstacle, 0), component)


def obstacle_moment(
    solution: "Equilibrium | History", obstacle: tuple[int, ...], component: Component | None = None
) -> Any:
    """Return the moment of a rigid obstacle on the rods about the point that it turns about, or its own.

    Parameters
    ----------
    obstacle
        Which one.
    component
        ``"x"``, ``"y"`` or ``"z"``; all three where not given.
    """
    return component_of(_of_obstacle(solution, obstacle, 1), component)


def _of_obstacle(solution: Any, contacts: tuple[int, ...], which: int) -> Any:
    """Return force (0) or moment (1) of an obstacle, by the contacts it is in, ``(3,)``; of a motion at each output."""
    if hasattr(solution, "path"):
        loads = next(step.obstacles for step in solution.path if step.factor == solution.factor)
        return loads[[*contacts], 3 * which : 3 * which + 3].sum(axis=0)
    found = solution.obstacle_moments if which else solution.obstacle_forces
    return found[:, [*contacts]].sum(axis=1)


def _pushes(solution: "Equilibrium", number: int) -> tuple[Array, Array]:
    """Return where the second side acts on the first, friction too, ``(q, 3)``, and its forces there, ``(q, 3)``."""
    refuse_others(solution, "contact")
    contact, result = solution.model.contacts[number], solution.contacts[number]
    if contact.second is None:
        raise InputError("contact: its rods touch each other, and no side acts on another; name a second one")
    own = np.isin(result.body, contact.groups[0]) & (not result.on_facets)
    forces = result.areas[:, None] * (result.pressure[:, None] * result.normals + result.tractions)
    return result.positions, np.asarray(np.where(own, 1.0, -1.0)[:, None] * forces)


def _patch(model: "Model", number: int, result: "ContactResult", component: str) -> float:
    """Return what `contact_patch` asks for, and warn of how well it is known."""
    contact = model.contacts[number]
    if component == "pressure":
        _warn(result.peak_error or 0.0, f"contact {number}: the largest pressure")
        return result.peak
    if component == "area":
        _warn(result.active and 1.0 / max(result.points_across, 1.0), f"contact {number}: the area")
        return result.area
    if result.on_facets:
        raise InputError(f"component: got {component!r}; of facets area and pressure are known alone")
    grids = [
        _Grid(result, body, model.bodies[body].space.rod.closed)
        for body in contact.groups[0]
        if (result.body == body).any()
    ]
    if component == "places":
        count = sum(int(one.number.max(initial=0)) for one in grids)
        # Of rods that touch each other both sides are seen.
        return float((count + 1) // 2 if contact.second is None else count)
    several = [one.extent(0 if component == "length" else 1) for one in grids]
    size, spacing = max(several, default=(0.0, 0.0))
    _warn(spacing / size if size else 0.0, f"contact {number}: the {component}")
    return size


def _warn(error: float, what: str) -> None:
    if error > _LARGE:
        warnings.warn(
            f"{what} of the patch is known to about {100.0 * error:.2g} %, the spacing of its "
            "points; use shorter elements and more section points there",
            stacklevel=5,
        )


class _Grid:
    """The points of a contact on a rod: rows at axis parameters, columns at angles.

    Attributes
    ----------
    number
        Of each point the place of contact it belongs to, from 1, zero where nothing touches.
    """

    def __init__(self, result: "ContactResult", body: int, closed: bool) -> None:
        mine = result.body == body
        (u, row), (angle, column) = (
            np.unique(np.round(one, 12), return_inverse=True) for one in result.parameters[mine].T
        )
        shape = u.size, angle.size
        self._pressure, self._places = np.zeros(shape), np.zeros((*shape, 3))
        np.maximum.at(self._pressure, (row, column), result.pressure[mine])
        self._places[row, column] = result.positions[mine]
        # Round a section the last angle is next to the first.
        self._closed = angle.size > 2 and bool(np.ptp(angle) + 1.5 * np.diff(angle).max() > 2.0 * np.pi)
        self.number = _places(self._pressure > 0.0, (closed, self._closed))

    def extent(self, direction: int) -> tuple[float, float]:
        """Return how long a place is along the rod (0) or round it (1) at most, and how far apart points are there."""
        return max(
            (max(self._lines(k, direction), default=(0.0, 0.0)) for k in _count(self.number)), default=(0.0, 0.0)
        )

    def _lines(self, place: int, direction: int) -> Iterator[tuple[float, float]]:
        """Yield how long each row or column of points is in a place, and the distance of its points."""
        inside, pressure, at = self.number == place, self._pressure, self._places
        if direction == 0:
            inside, pressure, at = inside.T, pressure.T, at.swapaxes(0, 1)
        for on, p, x in zip(inside, pressure, at, strict=True):
            if not on.any():
                continue
            if direction == 1 and self._closed:
                # Begin where nothing touches.
                first = int(np.argmin(on))
                on, p, x = (np.roll(one, -first, axis=0) for one in (on, p, x))
            distances = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1)))
            (k,) = np.nonzero(on)
            low, high = int(k[0]), int(k[-1])
            ends = [_edge(distances[::-1], p[::-1], len(p) - 1 - low), _edge(distances, p, high)]
            yield abs(ends[1] - ends[0]), abs(distances[high] - distances[low]) / max(high - low, 1)


def _edge(distances: Array, pressure: Array, last: int) -> float:
    """Return where the pressure ends behind the last point that has some, at a distance along a line of points.

    Near the edge of a smooth patch its square falls linearly (Hertz); it ends before the next point.
    """
    if last + 1 >= distances.size:
        return float(distances[last])
    if last == 0 or not pressure[last - 1] > pressure[last]:
        return float(0.5 * (distances[last] + distances[last + 1]))
    square = pressure[last] ** 2 / (pressure[last - 1] ** 2 - pressure[last] ** 2)
    beyond = (distances[last] - distances[last - 1]) * square
    return float(
        distances[last]
        + np.clip(abs(beyond), 0.0, abs(distances[last + 1] - distances[last])) * np.sign(distances[-1] - distances[0])
    )


def _places(touching: NDArray[Any], closed: tuple[bool, bool]) -> Index:
    """Return the number of the place of each point under pressure, from 1: points side by side have the same.

    Where rows or columns are ``closed`` the last is beside the first.
    """
    from scipy.ndimage import label
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    wrapped = np.pad(touching, [(0, int(one)) for one in closed], mode="wrap")
    number, count = label(wrapped, np.ones((3, 3)))
    rows, columns = touching.shape
    one = np.concatenate([number[:, 0] * closed[1], number[0] * closed[0]])
    other = np.concatenate([number[:, columns * closed[1]], number[rows * closed[0]]])
    both = (one > 0) & (other > 0)
    graph = coo_array((np.ones(both.sum()), (one[both], other[both])), shape=(count + 1, count + 1))
    # Without contact all are zero, and the first is taken.
    same = connected_components(graph, directed=False)[1]
    return np.asarray(same[number[:rows, :columns]], dtype=np.int64)


def _count(number: Index) -> range:
    return range(1, int(number.max(initial=0)) + 1)
