"""The compiled steps of `isorod.dynamics.explicit.step_kernel` with contact; loaded by models that have contacts."""

from numba import b1, f8, i8, types

from isorod.arrays import Array
from isorod.compiled import F1, STRICT, njit
from isorod.contact.force_kernel import PRESSING, add_forces
from isorod.dynamics.explicit.cholesky import FACTORS, Factors
from isorod.dynamics.explicit.contact import STEP_CONTACT, StepContact
from isorod.dynamics.explicit.end_faces import add_forces as add_face_forces
from isorod.dynamics.explicit.mesh import MESH, Mesh
from isorod.dynamics.explicit.step_kernel import (
    BLOWN,
    COURSE,
    DEEP,
    DISSIPATED,
    DONE,
    INVERTED,
    LOST,
    PUSHED,
    STATE,
    Course,
    State,
    evaluate,
    move,
)

# What `subtract` returns, a plain tuple, see `isorod.compiling.njit`.
STEP_PRESSING = types.UniTuple(f8, 8)
StepPressing = tuple[float, float, float, float, float, float, float, float]


@njit(PRESSING(STEP_CONTACT, F1), **STRICT)
def press(contact: StepContact, displacement: Array) -> tuple[float, float, float, float]:
    """Set ``positions`` and ``forces`` of a contact by its pressures."""
    order, positions, pushed = contact.order, contact.positions, contact.forces
    for d in range(order.size):
        positions[d // 3, d % 3] = contact.reference[d] + displacement[order[d]]
    pushed[:] = 0.0
    energy, force, area, deepest = add_forces(contact.packed, positions, pushed)
    more_energy, more_force, more_area, as_deep = add_face_forces(contact.faces, positions, pushed)
    return energy + more_energy, force + more_force, area + more_area, min(deepest, as_deep)


@njit(types.UniTuple(f8, 3)(STEP_CONTACT, F1), **STRICT)
def take(contact: StepContact, forces: Array) -> tuple[float, float, float]:
    """Subtract a contact's ``forces`` from internal forces, a state vector; return their sum."""
    order, pushed, carries = contact.order, contact.forces, contact.faces.carries
    x = y = z = 0.0
    for d in range(order.size):
        forces[order[d]] -= pushed[d // 3, d % 3]
    for node in range(pushed.shape[0]):
        x += carries[node] * pushed[node, 0]
        y += carries[node] * pushed[node, 1]
        z += carries[node] * pushed[node, 2]
    return x, y, z


@njit(STEP_PRESSING(STEP_CONTACT, F1, F1), **STRICT)
def subtract(contact: StepContact, displacement: Array, forces: Array) -> StepPressing:
    """Subtract the contact forces from internal forces, both state vectors.

    Returns
    -------
    energy, force, area, deepest
        As of `isorod.contact.force_kernel.add_forces`; with friction, its springs' energy is in the first.
    x, y, z
        Sum of all forces that rigid obstacles exert.
    dissipated
        What friction has dissipated since the last step.
    """
    energy, force, area, deepest = press(contact, displacement)
    x = y = z = 0.0
    if area > 0.0:
        x, y, z = take(contact, forces)
    return energy, force, area, deepest, x, y, z, 0.0


@njit(b1(STEP_CONTACT, f8), **STRICT)
def too_deep(contact: StepContact, deepest: float) -> bool:
    """Return whether a point of the last forces, of which the deepest gap is given, is deeper than it may be."""
    packed, limits = contact.packed, contact.limits
    if -deepest <= limits.min():
        return False
    for k in range(packed.passes.size):
        last = packed.passes[k + 1].first_point if k + 1 < packed.passes.size else packed.areas.size
        for point in range(packed.passes[k].first_point, last):
            state = packed.states[point]
            if state.pressure > 0.0 and -state.gap > limits[k]:
                return True
    return False


@njit(i8(STATE, FACTORS, COURSE, STEP_CONTACT, STEP_PRESSING), **STRICT)
def finish(state: State, factors: Factors, course: Course, contact: StepContact, pressing: StepPressing) -> int:
    """Move on by one step under forces of which those of contact are told; return the outcome."""
    energy, _, _, deepest, x, y, z, dissipated = pressing
    if not energy >= 0.0:
        return LOST
    if too_deep(contact, deepest):
        return DEEP
    state.sums[PUSHED] += course.step * x
    state.sums[PUSHED + 1] += course.step * y
    state.sums[PUSHED + 2] += course.step * z
    state.sums[DISSIPATED] += dissipated
    return DONE if move(state, factors, course) else BLOWN


@njit(types.UniTuple(i8, 2)(MESH, STATE, FACTORS, COURSE, i8, i8, STEP_CONTACT), **STRICT)
def advance(
    mesh: Mesh, state: State, factors: Factors, course: Course, first: int, last: int, contact: StepContact
) -> tuple[int, int]:
    """Take steps ``first`` to ``last - 1`` with contact; return how many of all were taken, and the outcome.

    Parameters
    ----------
    mesh, state, factors
        Elements, state vectors (changed) and the factors of the mass.
    course, first, last
        When step 0 begins, how long steps are and what they are told; which are wanted.
    contact
        From `isorod.dynamics.explicit.contact.pack`.
    """
    for k in range(first, last):
        if evaluate(mesh, state, course, k) > 0.0:
            return k, INVERTED
        pressing = subtract(contact, state.displacement, state.forces)
        outcome = finish(state, factors, course, contact, pressing)
        if outcome != DONE:
            return (k + 1 if outcome == BLOWN else k), outcome
    return last, DONE
