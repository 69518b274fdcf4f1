"""The compiled steps in time: central differences with half-step velocities, mass-proportional damping, and activation.

``(p+ - p-) / dt = -f(u) - c (p+ + p-) / 2``, ``u+ = u + dt v+`` with momenta ``p = M v``: explicit, of second order,
and stable up to ``omega dt = 2`` with or without damping.

With several ranks each takes the steps of its elements (`isorod.dynamics.explicit.ranks`).  Conditions that stop a run
are summed together with the momenta on edges: a kinetic energy is tested one step later, before the forces are used.
"""

from typing import NamedTuple

import numpy as np
from numba import f8, i8, types, u8, void
from numpy.typing import NDArray

from isorod.arrays import Array
from isorod.compiled import F1, STRICT, njit
from isorod.dynamics.explicit.element_kernel import elapse, internal_forces
from isorod.dynamics.explicit.exchange_kernel import (
    ENERGY,
    INVERTED_POINTS,
    MASS_FACTORS,
    NUMBERS,
    MassFactors,
    all_sums,
    divide,
    eliminate,
)
from isorod.dynamics.explicit.mesh import MESH, Mesh

# Outcomes of a series of steps: done; det F <= 0; kinetic energy above its limit; closest-point projection in contact
# did not converge; bodies in contact pass through each other.
DONE, INVERTED, BLOWN, LOST, DEEP = 0, 1, 2, 3, 4

# Indices in `State.sums`: dissipated energy, work of the activation's changes, impulse of rigid obstacles and of loads
# (3), and the work of these and of moving supports.
DISSIPATED, ACTIVATED, PUSHED, FOLLOWED = 0, 1, 2, 5


class State(NamedTuple):
    """State vectors, shape ``(dofs,)``, and sums over the steps taken.

    Attributes
    ----------
    displacement, velocity, momenta
        ``u`` at the time reached, ``v`` and ``p`` half a step before it; both are zero where held.
    forces
        Internal less contact forces of the last evaluation.
    held
        Places of the held degrees of freedom in a state vector.
    impulse
        Time integral of the supports' forces on the model, shape of ``held``.
    loads
        External forces in the next step, of this rank; empty where the model has none.
    sums
        Dissipated energy, ``sum W dalpha`` (``W`` the energy of active fibres at full activation ``alpha = 1``), the
        impulse of rigid obstacles and of loads, and the work of these and of moving supports, shape ``(6,)``.
    """

    displacement: Array
    velocity: Array
    momenta: Array
    forces: Array
    held: NDArray[np.uint64]
    impulse: Array
    sums: Array
    loads: Array


class Course(NamedTuple):
    """Parameters of a series of steps.

    Attributes
    ----------
    begin, step
        Time at the first step, and time step.
    ramp
        Time in which the activation grows linearly from 0 to 1; zero for full activation throughout.
    damping
        Mass-proportional damping ``c``, 1/time.
    limit
        Kinetic energy above which steps end.
    """

    begin: float
    step: float
    ramp: float
    damping: float
    limit: float


STATE = types.NamedTuple([F1, F1, F1, F1, types.Array(u8, 1, "C"), F1, F1, F1], State)
COURSE = types.NamedUniTuple(f8, 5, Course)


@njit(f8(f8, f8), **STRICT)
def activation(time: float, ramp: float) -> float:
    """Return the fraction of the full activation at a time."""
    if time >= ramp or ramp <= 0.0:
        return 1.0
    return max(time, 0.0) / ramp


@njit(f8(MESH, STATE, COURSE, i8), **STRICT)
def evaluate(mesh: Mesh, state: State, course: Course, k: int) -> float:
    """Evaluate the internal forces of step ``k`` and add to ``sum W dalpha``; return the number of inverted points.

    Laws with memory are updated: their states are those of the step before, at an output the present ones.
    """
    time = course.begin + k * course.step
    now = activation(time, course.ramp)
    # Half of the change to the next step and half of that from the last one: the trapezoidal rule.
    change = 0.5 * (activation(time + course.step, course.ramp) - activation(time - course.step, course.ramp))
    elapse(mesh, course.step if k > 0 else 0.0)
    inverted, _, active, _ = internal_forces(mesh, state.displacement, now, change > 0.0, True, state.forces)
    elapse(mesh, course.step)
    if change > 0.0:
        state.sums[ACTIVATED] += change * active
    return inverted


@njit(void(MESH, STATE, COURSE, MASS_FACTORS, f8), **STRICT)
def push(mesh: Mesh, state: State, course: Course, mass: MassFactors, inverted: float) -> None:
    """Change the momenta by the forces over one step; pass on the number of inverted points."""
    v, p, dt, spans = state.velocity, state.momenta, course.step, mesh.spans
    if state.loads.size:
        for s in range(spans.shape[0]):
            for d in range(spans[s, 0], spans[s, 1]):
                state.forces[d] -= state.loads[d]
    for h in range(state.held.size):
        place = state.held[h]
        state.impulse[h] += dt * state.forces[place]
        state.forces[place] = 0.0
    half = 0.5 * course.damping * dt
    keep, factor = (1.0 - half) / (1.0 + half), dt / (1.0 + half)
    # Twice the kinetic energy before, and the product of both velocities.
    before = mixed = 0.0
    for s in range(spans.shape[0]):
        for d in range(spans[s, 0], spans[s, 1]):
            before += v[d] * p[d]
            p[d] = keep * p[d] - factor * state.forces[d]
            mixed += v[d] * p[d]
    state.sums[DISSIPATED] += dt * course.damping * 0.25 * (before + 2.0 * mixed)
    mass.own[mass.own.size - NUMBERS + INVERTED_POINTS] = inverted


@njit(void(MESH, STATE, COURSE, MASS_FACTORS), **STRICT)
def move(mesh: Mesh, state: State, course: Course, mass: MassFactors) -> None:
    """Change the displacement over one step with the summed momenta; pass on the kinetic energy."""
    u, v, p, dt, spans = state.displacement, state.velocity, state.momenta, course.step, mesh.spans
    divide(mass, v)
    # Twice the kinetic energy.
    after = 0.0
    for s in range(spans.shape[0]):
        for d in range(spans[s, 0], spans[s, 1]):
            after += v[d] * p[d]
            u[d] += dt * v[d]
    state.sums[DISSIPATED] += dt * course.damping * 0.25 * after
    mass.own[mass.own.size - NUMBERS + ENERGY] = after


@njit(i8(COURSE, F1), **STRICT)
def outcome_of(course: Course, numbers: Array) -> int:
    """Return the outcome by the summed numbers: the energy of the step before, then the forces."""
    if not 0.5 * numbers[ENERGY] <= course.limit:
        return BLOWN
    return INVERTED if numbers[INVERTED_POINTS] > 0.0 else DONE


@njit(i8(COURSE, MASS_FACTORS), **STRICT)
def end(course: Course, mass: MassFactors) -> int:
    """Return the outcome of the last step."""
    mass.own[mass.own.size - NUMBERS + INVERTED_POINTS] = 0.0
    all_sums(mass.call, mass.own, mass.all)
    return outcome_of(course, mass.all[mass.all.size - NUMBERS :])


@njit(types.UniTuple(i8, 2)(MESH, STATE, COURSE, MASS_FACTORS, i8, i8), **STRICT)
def advance(mesh: Mesh, state: State, course: Course, mass: MassFactors, first: int, last: int) -> tuple[int, int]:
    """Take steps ``first`` to ``last - 1`` without contact; return the number of steps taken, and the outcome.

    Parameters
    ----------
    mesh, state
        Elements, and state vectors (changed).
    course, first, last
        Parameters of the steps, and the range of steps to take.
    mass
        Factors of the mass, and exchange between ranks.
    """
    mass.own[:] = 0.0
    for k in range(first, last):
        push(mesh, state, course, mass, evaluate(mesh, state, course, k))
        eliminate(mass, state.momenta)
        all_sums(mass.call, mass.own, mass.all)
        outcome = outcome_of(course, mass.all[mass.all.size - NUMBERS :])
        if outcome != DONE:
            return k, outcome
        move(mesh, state, course, mass)
    return last, end(course, mass)
