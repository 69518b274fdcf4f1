"""Explicit dynamics of the biceps' branches with dolfinx: central differences, lumped mass, contact, an activation that ramps up."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
import ufl
from scipy import sparse
from scipy.sparse.linalg import eigsh

from comparisons.fem import compat
from comparisons.fem.biceps.branches import Branches
from comparisons.fem.biceps.contact import Contact, Pressing
from comparisons.fem.statics import FAST
from comparisons.measure.timing import peak_memory
from isorod.errors import InputError, SolveError
from meshes.mesh import Array

# The same forces to 14 digits, a sixth faster.
FASTER = (*FAST, "-ffast-math")

# Central differences are stable up to 1; the critical step shrinks while the bodies deform.
SAFETY = 0.9


@dataclass(frozen=True, eq=False)
class Sample:
    """The state at a time.

    Attributes
    ----------
    time, activation
        Seconds; 0 to 1.
    positions
        Nodes, shape ``(nodes, 3)``, numbered as the source mesh.
    reactions
        Force of each end's support on its branch, shape ``(4, 3)``: what holds back internal forces there.
    kinetic, stored, dissipated
        Energies; the velocity is the mean of those half a step before and after.
    contact
        The contact's state, with its energy.
    """

    time: float
    activation: float
    positions: Array
    reactions: Array
    kinetic: float
    stored: float
    dissipated: float
    contact: Pressing


@dataclass(frozen=True, eq=False)
class Motion:
    """What explicit dynamics found.

    Attributes
    ----------
    samples
        At the times asked for, each rounded up to the next step.
    steps
        Number of steps.
    time_step, critical_step
        The last step taken, and the smallest critical step found, at rest or at a sample, seconds.
    seconds
        ``forms``, ``setup``, ``critical`` (critical steps), and of the steps ``internal`` (assembly of internal
        forces), ``contact``, ``update``; ``step`` is the wall time of one step.
    peak_memory
        Bytes.
    """

    samples: list[Sample]
    steps: int
    time_step: float
    critical_step: float
    seconds: dict[str, float]
    peak_memory: int


def lumped_mass(branches: Branches, density: float) -> Array:
    """Return the nodes' masses, shape ``(blocks,)``, in the order of the space.

    The diagonal of the consistent mass matrix, scaled to the whole mass: the row sums on linear tetrahedra, and on
    quadratic ones what Hinton, Rock, Zienkiewicz (Earthquake Eng. Struct. Dyn. 4 (1976) 245-249) propose, where row
    sums are negative at vertices.
    """
    mesh = branches.mesh
    space = compat.function_space(mesh, ("Lagrange", branches.source.order))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    dx = ufl.dx(metadata={"quadrature_degree": 2 * branches.source.order + 2})
    consistent = compat.form(density * u * v * dx, branches.flags)
    matrix = compat.create_matrix(consistent, None)
    compat.assemble_matrix(matrix, consistent, [])
    diagonal = matrix.getDiagonal().array.copy()
    total = matrix.createVecLeft()
    ones = matrix.createVecRight()
    ones.set(1.0)
    matrix.mult(ones, total)
    whole = total.sum()
    for thing in (matrix, total, ones):
        thing.destroy()
    return np.asarray(diagonal * (whole / diagonal.sum()))


def critical_step(branches: Branches, contact: Contact, mass: Array, free: Array, start: Array) -> tuple[float, Array]:
    """Return ``2 / omega`` of the highest frequency about the present state, and its mode to start the next search from.

    The tangent with the contact's stiffness, by Lanczos' method.
    """
    matrix = compat.create_matrix(branches.tangent, None)
    compat.assemble_matrix(matrix, branches.tangent, [])
    indptr, indices, values = matrix.getValuesCSR()
    stiffness = sparse.csr_array((values, indices, indptr), shape=matrix.getSize())
    matrix.destroy()
    pressing = contact.stiffness(branches.source.points + branches.to_nodes(branches.state.x.array))
    to_dof = (3 * branches.node_dofs[:, None] + np.arange(3)).ravel()
    pressing.row, pressing.col = to_dof[pressing.row], to_dof[pressing.col]
    scale = sparse.diags(free.ravel() / np.sqrt(np.repeat(mass, 3))).tocsr()
    operator = scale @ (stiffness + pressing.tocsr()) @ scale
    value, mode = eigsh(operator, k=1, which="LA", v0=start, tol=1e-3)
    return float(2.0 / np.sqrt(value[0])), mode[:, 0]


def solve(
    branches: Branches,
    contact: Contact,
    density: float,
    times: Sequence[float],
    activation: Callable[[float], float],
    damping: float = 0.0,
    time_step: float | None = None,
) -> Motion:
    """Return the motion from rest.

    Half-step velocities: ``(1 + c dt / 2) v_(n+1/2) = (1 - c dt / 2) v_(n-1/2) - dt M^-1 f(u_n, t_n)``,
    ``u_(n+1) = u_n + dt v_(n+1/2)``.

    Parameters
    ----------
    density
        Mass per volume.
    times
        When to sample, ascending; the last one ends the motion.
    activation
        Function of time.
    damping
        ``c`` in the damping force ``c M v``, 1/s.
    time_step
        Seconds; `SAFETY` times the critical step if None, made smaller at samples where that has shrunk.

    Raises
    ------
    SolveError
        If a value is not finite: the step was too long.
    """
    if not times or min(np.diff([0.0, *times])) <= 0.0:
        raise InputError(f"times: got {list(times)}, need positive ascending times")
    start = perf_counter()
    residual = branches.residual
    for form in ("tangent", "energy"):
        getattr(branches, form)
    seconds = {"forms": perf_counter() - start}
    start = perf_counter()
    mass = lumped_mass(branches, density)
    ends = branches.ends()
    free = np.ones((mass.size, 3))
    for end in ends:
        free.ravel()[end.dofs] = 0.0
    inverse = free / mass[:, None]
    rows = branches.node_dofs
    u = branches.state.x.array.reshape(-1, 3)
    u[:] = 0.0
    rest = branches.source.points
    internal = np.empty_like(u)
    pressed = np.empty_like(rest)
    velocity, before, acceleration = np.zeros_like(u), np.zeros_like(u), np.empty_like(u)
    seconds["setup"] = perf_counter() - start

    start = perf_counter()
    limit, mode = critical_step(branches, contact, mass, free, np.random.default_rng(0).random(u.size))
    seconds["critical"] = perf_counter() - start
    critical = limit
    dt = SAFETY * limit if time_step is None else time_step
    clock = dict.fromkeys(("internal", "contact", "update"), 0.0)
    samples: list[Sample] = []
    time, steps, dissipated = 0.0, 0, 0.0
    while True:
        due = time >= times[len(samples)] - 1e-9 * dt
        begin = perf_counter()
        branches.activation.value = activation(time)
        compat.assemble_array(internal.reshape(-1), residual)
        assembled = perf_counter()
        positions = rest + u[rows]
        pressed[:] = 0.0
        pressing = contact.add_forces(positions, pressed)
        touched = perf_counter()
        np.multiply(internal, inverse, out=acceleration)
        acceleration[rows] += pressed * inverse[rows]
        before[:] = velocity
        velocity *= 1.0 - 0.5 * damping * dt
        # The velocity at rest is the mean of those half a step before and after.
        acceleration *= dt if steps else dt * (0.5 + 0.25 * damping * dt)
        velocity -= acceleration
        velocity /= 1.0 + 0.5 * damping * dt
        done = perf_counter()
        mean = 0.5 * (before + velocity)
        kinetic = 0.5 * float(mass @ np.einsum("ni,ni->n", mean, mean))
        # Half of this step's before the sample, half behind.
        dissipated += dt * damping * kinetic
        if due:
            held = np.array([np.bincount(end.components, internal.ravel()[end.dofs], 3) for end in ends])
            stored = branches.stored()
            if not np.isfinite([kinetic, stored]).all():
                raise SolveError(f"explicit dynamics: not finite at {time:g} s; take a time step below {dt:.3g} s")
            samples.append(Sample(time, activation(time), positions, held, kinetic, stored, dissipated, pressing))
            if len(samples) == len(times):
                break
            start = perf_counter()
            limit, mode = critical_step(branches, contact, mass, free, mode)
            seconds["critical"] += perf_counter() - start
            critical = min(critical, limit)
            # What was half a step ahead with the old step is so with the new one to first order.
            if time_step is None and SAFETY * limit < dt:
                dt = SAFETY * limit
        dissipated += dt * damping * kinetic
        resumed = perf_counter()
        u += dt * velocity
        time += dt
        steps += 1
        clock["internal"] += assembled - begin
        clock["contact"] += touched - assembled
        clock["update"] += done - touched + perf_counter() - resumed
    seconds |= clock | {"step": sum(clock.values()) / steps}
    return Motion(samples, steps, dt, critical, seconds, peak_memory())
