"""What a scene file can ask of a solution; of a motion, at each output."""

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from isorod.arrays import Array

if TYPE_CHECKING:
    from isorod.dynamics.history import History
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
    xi: tuple[float, float] | None = None,
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
        Its point of the unit disk; where not given the centre, of a hollow rod the mean of its hole.
    component
        ``"x"``, ``"y"`` or ``"z"``; all three where not given.
    """
    where = "end" if u is None else u
    if hasattr(solution, "at"):
        return _component(solution.at(rod, where, xi), component)
    return _component(np.array([instant.at(rod, where, xi) for instant in solution]), component)


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
