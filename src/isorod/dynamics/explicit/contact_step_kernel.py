"""The compiled steps of `isorod.dynamics.explicit.step_kernel` with contact; loaded by models that have contacts."""

import numpy as np
from numba import f8, i8, njit, types, u8
from numpy.typing import NDArray

from isorod.arrays import Array
from isorod.compiled import F1, F2, STRICT
from isorod.contact.force_kernel import PACKED, Packed, add_forces
from isorod.dynamics.explicit.cholesky import FACTORS, Factors
from isorod.dynamics.explicit.end_faces import FACES, Faces
from isorod.dynamics.explicit.end_faces import add_forces as add_face_forces
from isorod.dynamics.explicit.mesh import MESH, Mesh
from isorod.dynamics.explicit.step_kernel import (
    BLOWN,
    COURSE,
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

_ORDER = types.Array(u8, 1, "C")


@njit(types.UniTuple(f8, 7)(PACKED, FACES, F1, _ORDER, F1, F1, F2, F2), **STRICT)
def subtract(
    packed: Packed,
    faces: Faces,
    reference: Array,
    order: NDArray[np.uint64],
    displacement: Array,
    forces: Array,
    positions: Array,
    scratch: Array,
) -> tuple[float, float, float, float, float, float, float]:
    """Subtract the contact forces from a state vector of internal forces.

    Parameters
    ----------
    packed, faces
        From `isorod.contact.pack` and `isorod.dynamics.explicit.end_faces.pack`.
    reference
        Coefficients of the undeformed bodies, numbered as the model's degrees of freedom, shape ``(dofs,)``.
    order
        From `isorod.dynamics.explicit.mesh.order`, shape ``(dofs,)``.
    displacement, forces
        State vectors.
    positions, scratch
        Work space, shape ``(nodes, 3)``.

    Returns
    -------
    energy, normal force, area in contact, deepest gap, and the sum of all forces (zero but for rigid obstacles)
        As `isorod.contact.force_kernel.add_forces`; NaN where a closest-point search failed.
    """
    for d in range(order.size):
        positions[d // 3, d % 3] = reference[d] + displacement[order[d]]
    scratch[:] = 0.0
    energy, normal, area, deepest = add_forces(packed, positions, scratch)
    on_faces = add_face_forces(faces, positions, scratch)
    energy, normal, area = energy + on_faces[0], normal + on_faces[1], area + on_faces[2]
    deepest = min(deepest, on_faces[3])
    x = y = z = 0.0
    if area > 0.0:
        for d in range(order.size):
            forces[order[d]] -= scratch[d // 3, d % 3]
        for node in range(scratch.shape[0]):
            x += faces.carries[node] * scratch[node, 0]
            y += faces.carries[node] * scratch[node, 1]
            z += faces.carries[node] * scratch[node, 2]
    return energy, normal, area, deepest, x, y, z


@njit(types.UniTuple(i8, 2)(MESH, STATE, FACTORS, COURSE, i8, PACKED, FACES, F1, _ORDER), **STRICT)
def advance(
    mesh: Mesh,
    state: State,
    factors: Factors,
    course: Course,
    steps: int,
    packed: Packed,
    faces: Faces,
    reference: Array,
    order: NDArray[np.uint64],
) -> tuple[int, int]:
    """Take a number of steps with contact; return how many were taken, and the outcome."""
    positions = np.empty((order.size // 3, 3))
    scratch = np.empty((order.size // 3, 3))
    for k in range(steps):
        if evaluate(mesh, state, course, k) > 0.0:
            return k, INVERTED
        energy, _, _, _, x, y, z = subtract(
            packed, faces, reference, order, state.displacement, state.forces, positions, scratch
        )
        if not energy >= 0.0:
            return k, LOST
        state.sums[PUSHED] += course.step * x
        state.sums[PUSHED + 1] += course.step * y
        state.sums[PUSHED + 2] += course.step * z
        if not move(state, factors, course):
            return k + 1, BLOWN
    return steps, DONE
