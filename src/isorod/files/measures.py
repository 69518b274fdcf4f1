"""What a scene file can ask of a solution; of a motion, at each output."""

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from isorod import choices
from isorod.arrays import Array
from isorod.errors import InputError
from isorod.output.words import Component as Stress

if TYPE_CHECKING:
    from isorod.dynamics.history import History
    from isorod.harmonic.response import Response
    from isorod.modal.kinds import Like
    from isorod.modal.modes import Modes
    from isorod.statics.analysis import Equilibrium

Component = Literal["x", "y", "z"]

# Section forces, in the order of the results.
Carried = Literal["axial", "shear_1", "shear_2", "torque", "bending_1", "bending_2"]
Vector = Literal["force", "moment"]

Slope = Literal["secant", "tangent"]

# An axis, through a point of its own or a section.
Axis = Literal["x", "y", "z"] | tuple[float, float, float]
Tangent = Literal["x", "y", "z", "tangent"] | tuple[float, float, float]

Point = tuple[float, float, float]
Shape = Literal["bending", "torsion", "axial"]

# So small a part of the largest force, or displacement, is rounding.
_ROUNDING = 1e-10

# Share from which a mode is what was asked for, and nothing is said.
_PURE = 0.9


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
    return component_of(rounded(solution.reactions[..., support, :], _carried(solution, "reactions")), component)


def moment(
    solution: "Equilibrium",
    support: int,
    component: Component | None = None,
    point: Point | None = None,
    about: Axis | None = None,
) -> Any:
    """Return the moment of a support on the model about the middle of its nodes, or a point (statics alone).

    Parameters
    ----------
    support
        Which one.
    component
        ``"x"``, ``"y"`` or ``"z"``; all three where not given.
    point
        About which it is, fixed in space; where not given the mean of the support's nodes in their present places.
    about
        An axis through that point, by its letter or a vector of any length: the moment about it alone.
    """
    from isorod.checks.reactions import support_places

    found = solution.moments[support]
    if point is not None:
        refuse_others(solution, "point")
        arm = support_places(solution.model, solution.displacement)[support] - np.array(point)
        found = found + np.cross(arm, solution.reactions[support])
    scale = max(_carried(solution, "moments"), _carried(solution, "reactions") * solution.model.size)
    return along(rounded(found, scale), component, about)


def displacement(
    solution: "Equilibrium | History | Response",
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
    values = _each(solution, lambda state: state.at(rod, "end" if u is None else u, xi))
    if hasattr(solution, "summary"):
        return component_of(values, component)
    return component_of(rounded(values, _largest(solution.displacement)), component)


def rotation(solution: "Equilibrium | History", rod: int, u: float | None = None, about: Tangent | None = None) -> Any:
    """Return by how much a section of a rod has turned in the mean, degrees: its vector, or the angle about an axis.

    Parameters
    ----------
    rod
        Whose section it is.
    u
        Axis parameter of the section; that of the end face where not given.
    about
        ``"x"``, ``"y"`` or ``"z"``, a vector of any length, or ``"tangent"``, that of the rod at rest: the angle about
        it, right-handed, as mean supports have it, whole turns counted from a held end.  Where not given the vector,
        along the axis of the rotation and as long as its angle.
    """

    def at_state(state: Any) -> Any:
        place, axis = "end" if u is None else u, about
        if about == "tangent":
            space = state.model.bodies[rod].space
            here = space.axis.breaks[-1] if u is None else u
            axis = space.rod.grid(np.zeros((1, 2)), [here])[1][0, 0, :, 2]
        turned = np.degrees(state.rotation(rod, place, None if axis is None else _axis(axis)))
        turned = rounded(turned, np.degrees(_largest(state.displacement)) / state.model.size)
        return float(turned) if turned.ndim == 0 else turned

    return _each(solution, at_state)


def stress(
    solution: "Equilibrium | History | Response",
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
        Axis parameter of the point; where not given the largest along the rod.
    xi
        Its point of the unit disk, ``[1, 0]`` on the surface; where not given the largest of the section.  Of
        ``"min_principal"`` the largest is the lowest value, of components that have two signs the largest in size.
    away
        Look for the largest no nearer to held faces and patches than this length along the centre line: at their edges
        stresses grow without bound as spaces are refined.
    """
    from isorod.files import peaks

    sought = peaks.Sought(rod, component, u, xi, away)
    if hasattr(solution, "summary"):
        from isorod.files import swings

        return swings.find(sought, solution)  # type: ignore[arg-type]
    values = _each(solution, sought.find)
    if choices.near():
        # The model beside this one, of a derivative: that one has warned.
        return values
    # Of a motion that in the end.
    state: Any = solution
    last, there = (state, values) if hasattr(state, "at") else (state[-1], values[-1])
    sought.warn(last, there)
    return values


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

    def at_state(state: Any) -> Any:
        carried = state.section_forces(rod, "end" if u is None else u)
        if component in ("force", "moment"):
            return getattr(carried, component)
        six = np.array([carried.N, *carried.Q, *carried.M])
        return six if component is None else float(six[get_args(Carried).index(component)])

    return _each(solution, at_state)


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


def frequency(solution: "Modes", rod: int, shape: Shape, direction: Axis | None = None, number: int = 1) -> float:
    """Return the frequency of a mode by its shape: the lowest that is mostly bending, torsion or stretching of a rod.

    Parameters
    ----------
    rod
        Whose motion it is.
    shape
        ``"bending"``, ``"torsion"`` or ``"axial"``: more than half of the rod's kinetic energy is in sections that move
        across its axis, turn about it, or move along it (`isorod.modal.kinds`).
    direction
        Of bending, in which sections move: by its letter or a vector; any where not given.
    number
        1 for the lowest of them, 2 for the next.
    """
    from isorod.modal import kinds

    refuse_others(solution, "frequency")
    mode = kinds.of_rod(solution, rod, shape, None if direction is None else _axis(direction), number)
    return _mostly(mode, shape)


def frequency_like(solution: "Modes", load: int) -> float:
    """Return the frequency of the mode most like the shape that a load gives the model from rest (the largest MAC).

    Parameters
    ----------
    load
        Which one; ``at_rest`` of the analysis leaves it out of what the modes are about.
    """
    from isorod.modal import kinds

    refuse_others(solution, "frequency_like")
    return _mostly(kinds.of_load(solution, load), "what the load makes")


def tie_force(solution: "Equilibrium | History", tie: int, component: Component | None = None) -> Any:
    """Return the force that a tie exerts on its slave, or one component of it (not of explicit steps).

    Parameters
    ----------
    tie
        Which one.
    component
        ``"x"``, ``"y"`` or ``"z"``; all three where not given.
    """
    return component_of(_of_tie(solution, tie, "force"), component)


def tie_moment(
    solution: "Equilibrium | History",
    tie: int,
    component: Component | None = None,
    point: Point | None = None,
    about: Axis | None = None,
) -> Any:
    """Return the moment that a tie exerts on its slave about the middle of its surface at rest, or a point.

    Not available in explicit steps.

    Parameters
    ----------
    tie
        Which one.
    component
        ``"x"``, ``"y"`` or ``"z"``; all three where not given.
    point
        About which it is, arms those at rest (statics alone); where not given the mean of the surface at rest.
    about
        An axis through that point, by its letter or a vector of any length: the moment about it alone.
    """
    total = _of_tie(solution, tie, "moment")
    if point is not None:
        refuse_others(solution, "point")
        if not hasattr(solution, "ties"):
            raise InputError("point: of motions the moment about the middle of the tie is known alone; leave it out")
        tied = solution.ties[tie]
        total = total + np.cross(tied.center - np.array(point), tied.force)
    return along(total, component, about)


def _of_tie(solution: Any, tie: int, name: str) -> Any:
    """Return what a tie has, ``(3,)``; of a motion at each output."""
    if hasattr(solution, "ties"):
        return getattr(solution.ties[tie], name)
    return getattr(solution, f"tie_{name}s")[:, tie]


def _each(solution: Any, ask: Callable[[Any], Any]) -> Any:
    """Return what is asked of a solution; of a motion, at each output."""
    if hasattr(solution, "at"):
        return ask(solution)
    results = [ask(instant) for instant in solution]
    return results if isinstance(results[0], tuple) else np.array(results)


def _mostly(mode: "Like", what: str) -> float:
    """Return the frequency of a mode, and warn where it is something else as well."""
    if mode.fraction < _PURE:
        warnings.warn(
            f"frequency {mode.frequency:.6g}: {100.0 * mode.fraction:.0f} % of this mode is {what}, the rest is not",
            stacklevel=3,
        )
    return mode.frequency


def refuse_others(solution: Any, key: str) -> None:
    """Raise `InputError` where a solution is one of finite elements, which have no counterpart of a key."""
    if not hasattr(solution, "built"):
        raise InputError(f"{key}: not available from finite elements; leave it out of what is compared")


def _carried(solution: Any, name: str) -> float:
    """Return the largest force, or moment, of supports, over all load steps: in the end they may be released."""
    before = (getattr(step, name) for step in getattr(solution, "path", ()))
    return max(_largest(getattr(solution, name)), *(_largest(one) for one in before), 0.0)


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def rounded(values: Array, scale: float) -> Array:
    """Return values in which what is rounding beside a scale, to which equilibria do not balance, is 0."""
    return np.where(np.abs(values) < _ROUNDING * scale, 0.0, values)


def _axis(axis: Any) -> Array:
    """Return the unit vector ``(3,)`` of an axis by its letter, or a vector."""
    from isorod.output.rotations import direction

    return np.eye(3)["xyz".index(axis)] if isinstance(axis, str) else direction("about", axis)


def along(vector: Array, component: str | None, about: Any) -> Any:
    """Return a vector ``(3,)``, or such of a motion, its component, or what it has along an axis."""
    if about is None:
        return component_of(vector, component)
    if component is not None:
        raise InputError("about: beside component; need one of the two")
    projected = vector @ _axis(about)
    return float(projected) if np.ndim(projected) == 0 else projected


def component_of(vector: Array, component: str | None) -> Any:
    """Return a vector ``(3,)``, or such of a motion, or one component of it."""
    if component is None:
        return vector
    selected = vector["xyz".index(component)] if vector.ndim == 1 else vector[:, "xyz".index(component)]
    return float(selected) if np.ndim(selected) == 0 else selected
