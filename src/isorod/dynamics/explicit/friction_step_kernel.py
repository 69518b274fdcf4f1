"""The compiled steps of `isorod.dynamics.explicit.contact_step_kernel` with friction; loaded by models that have it."""

from numba import b1, i8, types

from isorod.arrays import Array
from isorod.compiled import F1, STRICT, njit
from isorod.contact.friction_kernel import FRICTION, Friction, add_friction
from isorod.dynamics.explicit.cholesky import FACTORS, Factors
from isorod.dynamics.explicit.contact import STEP_CONTACT, StepContact
from isorod.dynamics.explicit.contact_step_kernel import (
    STEP_PRESSING,
    StepPressing,
    add_up,
    added,
    finish,
    prepare,
    press,
    take,
)
from isorod.dynamics.explicit.exchange_kernel import EXCHANGE, Exchange
from isorod.dynamics.explicit.mesh import MESH, Mesh
from isorod.dynamics.explicit.step_kernel import COURSE, DONE, STATE, Course, State, end


@njit(STEP_PRESSING(STEP_CONTACT, FRICTION, F1, b1, F1), **STRICT)
def subtract(contact: StepContact, friction: Friction, displacement: Array, keep: bool, forces: Array) -> StepPressing:
    """Subtract the forces of contact and friction from internal forces, both state vectors.

    Parameters
    ----------
    contact, friction
        From `isorod.dynamics.explicit.contact.pack` and `isorod.contact.friction.pack`.
    displacement, forces
        State vectors.
    keep
        As for `isorod.contact.friction_kernel.add_friction`.

    Returns
    -------
    pressing
        As of `isorod.dynamics.explicit.contact_step_kernel.subtract`.
    """
    energy, force, area, deepest = press(contact, displacement)
    dissipated = 0.0
    if energy >= 0.0:
        springs, dissipated = add_friction(contact.packed, friction, contact.positions, keep, contact.forces)
        energy += springs
    add_up(contact, energy, force, area, deepest)
    energy, force, area = added(contact)
    x = y = z = 0.0
    if area > 0.0:
        x, y, z = take(contact, forces)
    return energy, force, area, deepest, x, y, z, dissipated


@njit(types.UniTuple(i8, 2)(MESH, STATE, FACTORS, COURSE, EXCHANGE, i8, i8, STEP_CONTACT, FRICTION), **STRICT)
def advance(
    mesh: Mesh,
    state: State,
    factors: Factors,
    course: Course,
    exchange: Exchange,
    first: int,
    last: int,
    contact: StepContact,
    friction: Friction,
) -> tuple[int, int]:
    """Take steps ``first`` to ``last - 1`` with friction; return how many of all were taken, and the outcome.

    Parameters
    ----------
    mesh, state, factors, course, exchange, first, last, contact
        As for `isorod.dynamics.explicit.contact_step_kernel.advance`.
    friction
        As for `subtract`.
    """
    exchange.own[:] = 0.0
    for k in range(first, last):
        prepare(mesh, state, course, contact, exchange, k)
        pressing = subtract(contact, friction, state.displacement, True, state.forces)
        outcome = finish(mesh, state, factors, course, exchange, contact, pressing)
        if outcome != DONE:
            return k, outcome
    return last, end(course, exchange)
