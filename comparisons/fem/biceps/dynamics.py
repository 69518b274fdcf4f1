"""Explicit dynamics of the biceps' branches with dolfinx.

Central differences, lumped mass, contact, rising activation.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from scipy import sparse
from scipy.sparse.linalg import eigsh

from comparisons.fem.biceps.branches import Branches
from comparisons.fem.contact.surfaces import Contact, Pressing
from comparisons.measure.timing import Clock, peak_memory
from isorod.errors import InputError, SolveError
from isorod.fenics import compat
from isorod.fenics.flags import FAST
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
    """A motion by explicit dynamics.

    Attributes
    ----------
    samples
        At the times asked for, each rounded up to the next step.
    steps
        Number of steps.
    time_step, critical_step
        The last step taken, and the smallest critical step, at rest or at a sample, seconds.
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

    The diagonal of the consistent mass matrix, scaled to the total mass: the row sums on linear tetrahedra, and on
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
    total_mass = total.sum()
    for thing in (matrix, total, ones):
        thing.destroy()
    return np.asarray(diagonal * (total_mass / diagonal.sum()))


def critical_step(branches: Branches, contact: Contact, mass: Array, free: Array, start: Array) -> tuple[float, Array]:
    """Return ``2 / omega`` of the highest frequency about the present state, and its mode.

    The tangent with the contact's stiffness, by Lanczos' method.

    Parameters
    ----------
    branches, contact
        In their present state.
    mass
        Of the nodes in the order of the space, shape ``(blocks,)``.
    free
        1, or 0 where held, shape ``(blocks, 3)``.
    start
        Where the search starts: any vector ``(3 blocks,)``, or the last mode.
    """
    matrix = compat.create_matrix(branches.tangent, None)
    compat.assemble_matrix(matrix, branches.tangent, [])
    indptr, indices, values = matrix.getValuesCSR()
    stiffness = sparse.csr_array((values, indices, indptr), shape=matrix.getSize())
    matrix.destroy()
    pressing = contact.stiffness(branches.source.points + branches.to_nodes(branches.state.x.array))
    to_dof = branches.places.ravel()
    pressing.row, pressing.col = to_dof[pressing.row], to_dof[pressing.col]
    scale = sparse.diags(free.ravel() / np.sqrt(np.repeat(mass, 3))).tocsr()
    operator = scale @ (stiffness + pressing.tocsr()) @ scale
    value, mode = eigsh(operator, k=1, which="LA", v0=start, tol=1e-3)
    return float(2.0 / np.sqrt(value[0])), mode[:, 0]


class _State:
    """Displacement and half-step velocity, by central differences.

    ``(1 + c dt / 2) v_(n+1/2) = (1 - c dt / 2) v_(n-1/2) - dt M^-1 f(u_n, t_n)``, ``u_(n+1) = u_n + dt v_(n+1/2)``.
    """

    def __init__(self, branches: Branches, contact: Contact, density: float, damping: float) -> None:
        self.branches, self.contact, self.damping = branches, contact, damping
        self.mass = lumped_mass(branches, density)
        self.ends = branches.ends()
        self.free = np.ones((self.mass.size, 3))
        for end in self.ends:
            self.free.ravel()[end.dofs] = 0.0
        self.inverse = self.free / self.mass[:, None]
        self.u = branches.state.x.array.reshape(-1, 3)
        self.u[:] = 0.0
        self.velocity, self.mean = np.zeros_like(self.u), np.zeros_like(self.u)
        self.internal, self.acceleration = np.empty_like(self.u), np.empty_like(self.u)
        self.positions, self.pressed = branches.source.points, np.empty_like(branches.source.points)
        self._mode = np.random.default_rng(0).random(self.u.size)

    def critical_step(self) -> float:
        """Return the critical step about the present state."""
        step, self._mode = critical_step(self.branches, self.contact, self.mass, self.free, self._mode)
        return step

    def evaluate(self, activation: float, clock: Clock) -> Pressing:
        """Write the internal forces and those of contact, and return the contact's state."""
        self.branches.activation.value = activation
        compat.assemble_array(self.internal.reshape(-1), self.branches.residual)
        clock.lap("internal")
        self.positions = self.branches.source.points + self.u[self.branches.node_dofs]
        self.pressed[:] = 0.0
        pressing = self.contact.add_forces(self.positions, self.pressed)
        clock.lap("contact")
        return pressing

    def accelerate(self, dt: float, rest: bool) -> None:
        """Take the velocity half a step ahead, from rest or from half a step behind."""
        rows = self.branches.node_dofs
        np.multiply(self.internal, self.inverse, out=self.acceleration)
        self.acceleration[rows] += self.pressed * self.inverse[rows]
        self.mean[:] = self.velocity
        self.velocity *= 1.0 - 0.5 * self.damping * dt
        # The velocity at rest is the mean of those half a step before and after.
        self.acceleration *= dt * (0.5 + 0.25 * self.damping * dt) if rest else dt
        self.velocity -= self.acceleration
        self.velocity /= 1.0 + 0.5 * self.damping * dt

    def kinetic(self) -> float:
        """Return the kinetic energy, once a step: of the mean of the velocities half a step before and after."""
        self.mean += self.velocity
        self.mean *= 0.5
        return 0.5 * float(self.mass @ np.einsum("ni,ni->n", self.mean, self.mean))

    def sample(self, time: float, kinetic: float, dissipated: float, pressing: Pressing, dt: float) -> Sample:
        """Return the state, or raise `SolveError` where it is not finite."""
        held = np.array([np.bincount(end.components, self.internal.ravel()[end.dofs], 3) for end in self.ends])
        stored = self.branches.stored()
        if not np.isfinite([kinetic, stored]).all():
            raise SolveError(f"explicit dynamics: not finite at {time:g} s; take a time step below {dt:.3g} s")
        activation = float(self.branches.activation.value)
        return Sample(time, activation, self.positions, held, kinetic, stored, dissipated, pressing)


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

    Parameters
    ----------
    branches, contact
        What moves, and what keeps its parts apart.
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
    clock, stepping = Clock(), Clock()
    branches.compile()
    clock.lap("forms")
    state = _State(branches, contact, density, damping)
    clock.lap("setup")
    critical = state.critical_step()
    clock.lap("critical")
    dt = SAFETY * critical if time_step is None else time_step
    samples: list[Sample] = []
    time, steps, dissipated = 0.0, 0, 0.0
    while True:
        stepping.resume()
        pressing = state.evaluate(activation(time), stepping)
        state.accelerate(dt, steps == 0)
        stepping.lap("update")
        kinetic = state.kinetic()
        # Half of this step's before the sample, half behind.
        dissipated += dt * damping * kinetic
        if time >= times[len(samples)] - 1e-9 * dt:
            samples.append(state.sample(time, kinetic, dissipated, pressing, dt))
            if len(samples) == len(times):
                break
            clock.resume()
            limit = state.critical_step()
            clock.lap("critical")
            critical = min(critical, limit)
            # What was half a step ahead with the old step is so with the new one to first order.
            if time_step is None:
                dt = min(dt, SAFETY * limit)
        dissipated += dt * damping * kinetic
        stepping.resume()
        state.u += dt * state.velocity
        stepping.lap("update")
        time += dt
        steps += 1
    # The last state is evaluated too.
    step = sum(stepping.seconds.values()) / (steps + 1)
    return Motion(samples, steps, dt, critical, clock.seconds | stepping.seconds | {"step": step}, peak_memory())
