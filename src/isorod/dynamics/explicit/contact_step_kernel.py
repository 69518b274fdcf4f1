"""The compiled steps of `isorod.dynamics.explicit.step_kernel` with contact; loaded by models that have contacts."""

import numpy as np
from numba import b1, f8, i8, types, void

from isorod.arrays import Array
from isorod.compiled import F1, STRICT, njit
from isorod.contact.force_kernel import add_forces
from isorod.contact.friction_kernel import add_friction
from isorod.contact.lift_kernel import lift, lower
from isorod.contact.placing_kernel import obstacle_loads, obstacle_work, place_obstacles
from isorod.dynamics.explicit.contact import (
    AREA,
    CONTACT_ENERGY,
    FORCE,
    NUMBERS,
    STEP_CONTACT,
    TOO_DEEP,
    StepContact,
)
from isorod.dynamics.explicit.exchange_kernel import (
    ENERGY,
    INVERTED_POINTS,
    MASS_FACTORS,
    MassFactors,
    all_sums,
    eliminate,
)
from isorod.dynamics.explicit.exchange_kernel import NUMBERS as MASS_NUMBERS
from isorod.dynamics.explicit.mesh import MESH, Mesh
from isorod.dynamics.explicit.step_kernel import (
    COURSE,
    DEEP,
    DISSIPATED,
    DONE,
    FOLLOWED,
    LOST,
    PUSHED,
    STATE,
    Course,
    State,
    end,
    evaluate,
    move,
    outcome_of,
    push,
)

# Type of the result of `subtract`, a plain tuple, see `isorod.compiling.njit`.
STEP_PRESSING = types.UniTuple(f8, 8)
StepPressing = tuple[float, float, float, float, float, float, float, float]


@njit(b1(STEP_CONTACT, f8), **STRICT)
def too_deep(contact: StepContact, deepest: float) -> bool:
    """Return whether a penetration at the last forces, whose smallest gap is given, exceeds its limit."""
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


@njit(void(STEP_CONTACT, F1), **STRICT)
def meet(contact: StepContact, displacement: Array) -> None:
    """Fill in a displacement, a state vector, the surface nodes of other ranks."""
    order, shared, own = contact.order, contact.shared, contact.own
    if contact.call[0] == 0:
        return
    own[:] = 0.0
    for c in range(shared.size):
        if contact.mine[shared[c]]:
            for a in range(3):
                own[3 * c + a] = displacement[order[3 * shared[c] + a]]
    all_sums(contact.call, own, contact.all)
    for c in range(shared.size):
        for a in range(3):
            displacement[order[3 * shared[c] + a]] = contact.all[3 * c + a]


@njit(void(STEP_CONTACT, f8, f8, f8, f8), **STRICT)
def add_up(contact: StepContact, energy: float, force: float, area: float, deepest: float) -> None:
    """Sum the ``forces`` of all ranks' points, and the numbers that follow them."""
    shared, pushed, own, added = contact.shared, contact.forces, contact.own, contact.all
    first = own.size - NUMBERS
    own[first + CONTACT_ENERGY], own[first + FORCE], own[first + AREA] = energy, force, area
    own[first + TOO_DEEP] = 1.0 if too_deep(contact, deepest) else 0.0
    if contact.call[0] == 0:
        added[first:] = own[first:]
        return
    for c in range(shared.size):
        for a in range(3):
            own[3 * c + a] = pushed[shared[c], a]
    all_sums(contact.call, own, added)
    for c in range(shared.size):
        for a in range(3):
            pushed[shared[c], a] = added[3 * c + a]


@njit(types.UniTuple(f8, 3)(STEP_CONTACT, F1), **STRICT)
def take(contact: StepContact, forces: Array) -> tuple[float, float, float]:
    """Subtract a contact's ``forces`` on this rank's nodes from internal forces, a state vector; return their sum."""
    order, pushed, carries, mine = contact.order, contact.forces, contact.carries, contact.mine
    x = y = z = 0.0
    for d in range(order.size):
        if mine[d // 3]:
            forces[order[d]] -= pushed[d // 3, d % 3]
    for node in range(carries.size):
        if not mine[node]:
            continue
        x += carries[node] * pushed[node, 0]
        y += carries[node] * pushed[node, 1]
        z += carries[node] * pushed[node, 2]
    return x, y, z


@njit(STEP_PRESSING(STEP_CONTACT, F1, b1, F1), **STRICT)
def subtract(contact: StepContact, displacement: Array, keep: bool, forces: Array) -> StepPressing:
    """Subtract the forces of contact and friction from internal forces.

    Parameters
    ----------
    contact
        From `isorod.dynamics.explicit.contact.pack`.
    displacement, forces
        State vectors.
    keep
        As for `isorod.contact.friction_kernel.add_friction`.

    Returns
    -------
    energy, force, area, deepest
        As of `isorod.contact.force_kernel.add_forces`; the energy includes frictional springs.  ``deepest`` is that of
        this rank's points.
    x, y, z
        Sum of all forces that rigid obstacles exert on this rank's nodes.
    dissipated
        Dissipation by friction at this rank's points since the last step.
    """
    order, positions, pushed = contact.order, contact.positions, contact.forces
    for d in range(order.size):
        positions[d // 3, d % 3] = contact.reference[d] + displacement[order[d]]
    pushed[:] = 0.0
    lift(contact.packed, positions)
    energy, force, area, deepest = add_forces(contact.packed, positions, pushed)
    dissipated = 0.0
    if energy >= 0.0:
        springs, dissipated = add_friction(contact.packed, contact.friction, positions, keep, pushed)
        energy += springs
    lower(contact.packed, pushed)
    add_up(contact, energy, force, area, deepest)
    numbers = contact.all[contact.all.size - NUMBERS :]
    energy, force, area = numbers[CONTACT_ENERGY], numbers[FORCE], numbers[AREA]
    x = y = z = 0.0
    if area > 0.0:
        x, y, z = take(contact, forces)
    return energy, force, area, deepest, x, y, z, dissipated


@njit(i8(MESH, STATE, COURSE, MASS_FACTORS, STEP_CONTACT, STEP_PRESSING), **STRICT)
def finish(
    mesh: Mesh,
    state: State,
    course: Course,
    mass: MassFactors,
    contact: StepContact,
    pressing: StepPressing,
) -> int:
    """Finish a step, given the result of `subtract`; return the outcome."""
    energy, _, _, _, x, y, z, dissipated = pressing
    numbers = contact.all[contact.all.size - NUMBERS :]
    outcome = outcome_of(course, numbers)
    if outcome != DONE:
        return outcome
    if not energy >= 0.0:
        return LOST
    if numbers[TOO_DEEP] > 0.0:
        return DEEP
    state.sums[PUSHED] += course.step * x
    state.sums[PUSHED + 1] += course.step * y
    state.sums[PUSHED + 2] += course.step * z
    state.sums[DISSIPATED] += dissipated
    push(mesh, state, course, mass, 0.0)
    eliminate(mass, state.momenta)
    if mass.left.size:
        all_sums(mass.call, mass.own, mass.all)
    move(mesh, state, course, mass)
    return DONE


@njit(types.UniTuple(i8, 2)(MESH, STATE, COURSE, MASS_FACTORS, i8, i8, STEP_CONTACT), **STRICT)
def advance(
    mesh: Mesh,
    state: State,
    course: Course,
    mass: MassFactors,
    first: int,
    last: int,
    contact: StepContact,
) -> tuple[int, int]:
    """Take steps ``first`` to ``last - 1`` with contact; return the number of steps taken, and the outcome.

    Parameters
    ----------
    mesh, state, course, mass, first, last
        As for `isorod.dynamics.explicit.step_kernel.advance`.
    contact
        From `isorod.dynamics.explicit.contact.pack`.
    """
    mass.own[:] = 0.0
    behind, loads = contact.own.size - NUMBERS, np.empty((contact.packed.passes.size, 6))
    for k in range(first, last):
        time = course.begin + k * course.step
        place_obstacles(contact.packed, time)
        inverted = evaluate(mesh, state, course, k)
        meet(contact, state.displacement)
        contact.own[behind + INVERTED_POINTS] = inverted
        contact.own[behind + ENERGY] = mass.own[mass.own.size - MASS_NUMBERS + ENERGY]
        pressing = subtract(contact, state.displacement, True, state.forces)
        if contact.packed.tracks.size:
            obstacle_loads(contact.packed, contact.friction, loads)
            # Half of the motion to the next step and half of that from the last one: the trapezoidal rule.
            work = obstacle_work(contact.packed, loads, time - course.step, time + course.step)
            state.sums[FOLLOWED] += 0.5 * work
        outcome = finish(mesh, state, course, mass, contact, pressing)
        if outcome != DONE:
            return k, outcome
    return last, end(course, mass)
