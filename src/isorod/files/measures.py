"""What a scene file can ask of a solution; of a motion, at each output."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from isorod.arrays import Array
from isorod.output.words import Component as Stress

if TYPE_CHECKING:
    from isorod.dynamics.history import History
    from isorod.statics.analysis import Equilibrium

Component = Literal["x", "y", "z"]

# What a section carries, in the order in which all of it is told.
Carried = Literal["axial", "shear_1", "shear_2", "torque", "bending_1", "bending_2"]
Vector = Literal["force", "moment"]

Slope = Literal["secant", "tangent"]


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
    return _component(_each(solution, lambda state: state.at(rod, "end" if u is None else u, xi)), component)


def stress(
    solution: "Equilibrium | History",
    rod: int,
    component: Stress = "von_mises",
    u: float | None = None,
    xi: tuple[float, float] | None = None,
    away: float | None = None,
) -> Any:
    """Return Cauchy's stress at a point of a rod, force per area; without a place the largest, and where it is.

    Parameters
    ----------
    rod
        Whose stress it is.
    component
        ``"von_mises"``; ``"max_principal"`` or ``"min_principal"``, the largest and the smallest principal stress;
        ``"xx"`` ... ``"yz"``, a component in space; ``"along"``, normal to the section in its present place, or
        ``"shear"``, the size of the shear stress in the section.
    u
        Axis parameter of the point; where not given the largest along the rod is told.
    xi
        Its point of the unit disk, ``[1, 0]`` on the surface; where not given the largest of the section is told.  Of
        ``"min_principal"`` the largest is the lowest value, of components that have two signs the largest in size.
    away
        Look for the largest no nearer to held faces and patches than this length along the centre line: at their edges
        stresses grow without bound as spaces are refined.
    """
    from isorod.files import peaks

    sought = peaks.Sought(rod, component, u, xi, away)
    found = _each(solution, sought.find)
    # Of a motion that in the end.
    state: Any = solution
    last, there = (state, found) if hasattr(state, "at") else (state[-1], found[-1])
    sought.warn(last, there)
    return found


def section_force(
    solution: "Equilibrium | History", rod: int, u: float | None = None, component: Carried | Vector | None = None
) -> Any:
    """Return what a section of a rod carries, the action of what is beyond it on what is before; or a part of it.

    Parameters
    ----------
    rod
        Whose section it is.
    u
        Axis parameter of the section; that of the end face where not given.
    component
        In the directions of the section in its present place (`isorod.output.section_forces`): ``"axial"``, positive in
        tension, ``"shear_1"``, ``"shear_2"``, ``"torque"``, ``"bending_1"``, ``"bending_2"`` about its centroid; these
        six where not given.  ``"force"`` and ``"moment"`` are the vectors in space.
    """

    def found(state: Any) -> Any:
        carried = state.section_forces(rod, "end" if u is None else u)
        if component in ("force", "moment"):
            return getattr(carried, component)
        six = np.array([carried.N, *carried.Q, *carried.M])
        return six if component is None else float(six[get_args(Carried).index(component)])

    return _each(solution, found)


def energy(solution: "Equilibrium | History", rod: int) -> Any:
    """Return the energy stored in a rod, force times length; of a muscle with that of its active fibres.

    Parameters
    ----------
    rod
        Which one.
    """
    return _each(solution, lambda state: state.energy(rod))


def stiffness(solution: "Equilibrium", support: int, slope: Slope = "secant") -> float:
    """Return the stiffness against a support's motion, as a spring's rate: force per length, or moment per radian.

    Whatever else loads the model is as it is (statics alone).

    Parameters
    ----------
    support
        Which one: it has a ``displacement``, or a ``turn``.
    slope
        ``"secant"``: the force along the displacement over the displacement, or the moment along the turn, about the
        point it turns about, over the turn.  ``"tangent"``: how fast that grows at the end of the motion.
    """
    from isorod.files import rates

    return rates.secant(solution, support) if slope == "secant" else rates.tangent(solution, support)


def contact_force(solution: "Equilibrium", contact: int) -> float:
    """Return the total normal force of a contact (statics alone; a motion's record has that of all contacts).

    Parameters
    ----------
    contact
        Which one.
    """
    return float(solution.contacts[contact].force)


def tie_force(solution: "Equilibrium | History", tie: int, component: Component | None = None) -> Any:
    """Return the force that a tie exerts on its slave, or one component of it (not of explicit steps).

    Parameters
    ----------
    tie
        Which one.
    component
        ``"x"``, ``"y"`` or ``"z"``; all three where not given.
    """
    return _component(_of_tie(solution, tie, "force"), component)


def tie_moment(solution: "Equilibrium | History", tie: int, component: Component | None = None) -> Any:
    """Return the moment that a tie exerts on its slave about the middle of its surface at rest.

    Explicit steps do not tell it.

    Parameters
    ----------
    tie
        Which one.
    component
        ``"x"``, ``"y"`` or ``"z"``; all three where not given.
    """
    return _component(_of_tie(solution, tie, "moment"), component)


def _of_tie(solution: Any, tie: int, name: str) -> Any:
    """Return what a tie has, ``(3,)``; of a motion at each output."""
    if hasattr(solution, "ties"):
        return getattr(solution.ties[tie], name)
    return getattr(solution, f"tie_{name}s")[:, tie]


def _each(solution: Any, ask: Callable[[Any], Any]) -> Any:
    """Return what is asked of a solution; of a motion, at each output."""
    if hasattr(solution, "at"):
        return ask(solution)
    found = [ask(instant) for instant in solution]
    return found if isinstance(found[0], tuple) else np.array(found)


def _component(vector: Array, component: str | None) -> Any:
    if component is None:
        return vector
    found = vector["xyz".index(component)] if vector.ndim == 1 else vector[:, "xyz".index(component)]
    return float(found) if np.ndim(found) == 0 else found
