"""What a scene file can ask of a solution; of a motion, at each output."""

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array

if TYPE_CHECKING:
    from isorod.dynamics.analysis import History
    from isorod.statics.analysis import Equilibrium

Component = Literal["x", "y", "z"]


def geometry() -> None:
    """Tell volume, smallest Jacobian determinant and number of control points of the rods, and no mechanics."""


def reaction(solution: "Equilibrium | History", support: int, component: Component | None = None) -> Any:
    """Return the force of a support on the model, or one component of it.

    Parameters
    ----------
    support
        Which one.
    component
        ``"x"``, ``"y"`` or ``"z"``; all three where not given.
    """
    return _component(solution.reactions[..., support, :], component)


def moment(solution: "Equilibrium", support: int, component: Component | None = None) -> Any:
    """Return the moment of a support on the model about the middle of its nodes (statics alone).

    Parameters
    ----------
    support
        Which one.
    component
        ``"x"``, ``"y"`` or ``"z"``; all three where not given.
    """
    return _component(solution.moments[support], component)


def displacement(
    solution: "Equilibrium | History",
    rod: int,
    u: float | None = None,
    xi: tuple[float, float] = (0.0, 0.0),
    component: Component | None = None,
) -> Any:
    """Return the displacement of a point of a rod, or one component of it.

    Parameters
    ----------
    rod
        Whose point it is.
    u
        Axis parameter of the point; that of the end face where not given.
    xi
        Its point of the unit disk; the centre line is the disk's centre.
    component
        ``"x"``, ``"y"`` or ``"z"``; all three where not given.
    """
    space = solution.model.bodies[rod].space
    where = [space.axis.breaks[-1] if u is None else u]

    def point(state: ArrayLike) -> Array:
        return space.displacement(solution.model.nodal(np.asarray(state), rod), [xi], where)[0][0, 0]

    states = solution.displacement
    found = point(states) if states.ndim == 1 else np.array([point(state) for state in states])
    return _component(found, component)


def contact_force(solution: "Equilibrium", contact: int) -> float:
    """Return the total normal force of a contact (statics alone; a motion's record has that of all contacts).

    Parameters
    ----------
    contact
        Which one.
    """
    return float(solution.contacts[contact].force)


def _component(vector: Array, component: str | None) -> Any:
    if component is None:
        return vector
    found = vector["xyz".index(component)] if vector.ndim == 1 else vector[:, "xyz".index(component)]
    return float(found) if np.ndim(found) == 0 else found
