"""A model in the arrays of compiled explicit dynamics, with state vectors in their own order."""

from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc
from scipy.linalg import eigh_tridiagonal

from isorod.arrays import Array
from isorod.assembly.gradients import deformation_gradients
from isorod.dynamics.explicit import states, step_kernel
from isorod.dynamics.explicit.drive import Drive
from isorod.dynamics.explicit.element_kernel import elapse, internal_forces
from isorod.dynamics.explicit.exchange_kernel import all_sums, divide, eliminate
from isorod.dynamics.explicit.mass import Mass
from isorod.dynamics.explicit.mesh import GEOMETRY, POINTS, Mesh, digests, order, pack
from isorod.dynamics.explicit.ranks import Ranks
from isorod.dynamics.explicit.step_kernel import Course, State
from isorod.model.model import Model
from isorod.tensors import determinant

if TYPE_CHECKING:
    from isorod.contact.packed import Packed, Table
    from isorod.dynamics.explicit.contact import StepContact
    from isorod.dynamics.explicit.ties import Ties

# Relative accuracy of the highest eigenvalue, maximum number of iterations, and fraction of noise in the first vector.
_TOLERANCE = 1e-3
_LANCZOS = 100
_MIXED = 0.05


class System:
    """A model in motion: its compiled arrays, the state, and functions of both.

    Parameters
    ----------
    model
        Bodies with densities, supports, contacts.
    comm
        The ranks; this one alone by default.
    explicit
        Whether steps are explicit, with loads and moving supports by `Drive`.
    points
        Points of each pass of contacts (`isorod.contact.tables.pack`); chosen by default.

    Attributes
    ----------
    ranks
        The partition of the model over ranks.
    points
        Points of each pass of contacts, round an arc and along an element.
    mass, factors
        The mass, and its factors; see `scale`.
    drive
        Loads, springs and moving supports of explicit steps, None without these.
    ties
        The ties of explicit steps, None before `tie`.
    beyond
        Displacement of facets of finite element bodies that rods touch, ``(b,)``; they move in implicit steps alone.
    """

    def __init__(
        self,
        model: Model,
        comm: PETSc.Comm | None = None,
        explicit: bool = False,
        points: list[tuple[int, int]] | None = None,
    ) -> None:
        self.model = model
        driven = explicit and bool(model.loads or model.means or model.moves)
        self.order = order(model)
        self.ranks = Ranks(model, self.order, comm)
        self.mesh = pack(model, self.ranks)
        self.free = self.order[model.free >= 0]
        # Indices of this rank's among the free ones.
        self._mine = np.flatnonzero(self.ranks.owned[model.free >= 0])
        self.mass = Mass(model, self.order, self.ranks)
        self.ties: Ties | None = None
        self.factors = self.mass.factors()
        self.state = State(
            displacement=np.zeros(model.dofs),
            velocity=np.zeros(model.dofs),
            momenta=np.zeros(model.dofs),
            forces=np.zeros(model.dofs),
            held=self.order[model.held].astype(np.uint64),
            impulse=np.zeros(model.held.size),
            sums=np.zeros(6),
            loads=np.zeros(model.dofs if driven else 0),
        )
        self.drive = Drive(self) if driven else None
        # Momenta of the mode of highest frequency, from the last estimate.
        self.highest = np.zeros(self.free.size)
        # The smallest cube root of a quadrature point's volume, for finite differences.
        volumes = self.mesh.geometry.reshape(-1, GEOMETRY, POINTS)[:, 9]
        self._size = self.ranks.smallest(float(volumes[volumes > 0.0].min(initial=np.inf))) ** (1.0 / 3.0)
        self.contact: StepContact | None = None
        self.points: list[tuple[int, int]] = []
        if model.contacts:
            from isorod.contact.defaults import points_of
            from isorod.dynamics.explicit import contact

            self.points = points_of(model) if points is None else points
            self.contact = contact.pack(model, self.order, self.ranks, self.points)
        self.beyond = np.zeros(0 if self.contact is None else self.contact.order.size - model.dofs)

    @property
    def starts(self) -> Array:
        """Initial guesses of the closest-point projections: the history of contact without friction."""
        if self.contact is None:
            return np.empty(0)
        return self._of_all_points(self.contact.packed, self.contact.packed.starts)

    @property
    def anchors(self) -> Array:
        """History of friction."""
        if self.contact is None:
            return np.empty(0)
        return self._of_all_points(self.contact.packed, self.contact.friction.anchors)

    def _of_all_points(self, packed: "Packed", table: "Table") -> "Table":
        """Fill in a table the rows of other ranks' points, and return it."""
        from isorod.contact import ranks

        ranks.Ranks(self.ranks.communicator).gather(packed, table)
        return table

    @property
    def contact_data(self) -> "tuple[Array | Table, ...]":
        """Constant data of the contacts."""
        if self.contact is None:
            return ()
        return (*self.contact.packed.fixed, self.contact.friction.coefficients)

    def digest(self) -> str:
        """Return a digest of the elements, independent of the number of ranks."""
        return sha256(b"".join(chain.from_iterable(self.ranks.gather(digests(self.mesh))))).hexdigest()

    @contextmanager
    def parted(self) -> Iterator[None]:
        """Split momenta and sums over ranks for the steps taken within; then gather them on all ranks again.

        Results are the same to the last bit wherever this is done.
        """
        if self.ranks.size == 1:
            yield
            return
        state = self.state
        before = state.impulse.copy(), state.sums.copy()
        state.momenta[self.ranks.others] = state.impulse[:] = state.sums[:] = 0.0
        yield
        for vector in (state.displacement, state.velocity):
            vector[:] = self.ranks.whole(vector)
        momenta = np.zeros_like(state.momenta)
        for first, last in self.mesh.spans:
            momenta[first:last] = state.momenta[first:last]
        state.momenta[:] = self.ranks.sums(momenta)
        state.impulse[:] = before[0] + self.ranks.sums(state.impulse)
        state.sums[:] = before[1] + self.ranks.sums(state.sums)

    def advance(self, course: Course, first: int, last: int) -> tuple[int, int]:
        """Take steps ``first`` to ``last - 1``; return as `isorod.dynamics.explicit.step_kernel.advance` does.

        With several ranks, momenta and sums are split (`parted`).
        """
        if self.drive is None:
            return self._advance(course, first, last)
        for k in range(first, last):
            self.drive.begin(course.begin + k * course.step, course)
            taken, outcome = self._advance(course, k, k + 1)
            if outcome != step_kernel.DONE:
                return taken, outcome
            self.drive.end(course)
        return last, step_kernel.DONE

    def _advance(self, course: Course, first: int, last: int) -> tuple[int, int]:
        arguments = self.mesh, self.state, course, self.factors, first, last
        if self.contact is None:
            return step_kernel.advance(*arguments)
        from isorod.dynamics.explicit import contact_step_kernel

        return contact_step_kernel.advance(*arguments, self.contact)

    def scale(self, scaling: float) -> None:
        """Add mass; see `isorod.dynamics.explicit.mass`."""
        if scaling == self.mass.scaling and not self.mass.follows:
            return
        self.mass.scaling = scaling
        self._factorise()

    def tie(self) -> None:
        """Constrain velocities by ties; implicit steps have ties of their own."""
        from isorod.dynamics.explicit.ties import Ties

        self.ties = Ties(self.model, self.order, self.ranks)
        self._factorise()

    def _factorise(self) -> None:
        self.factors = self.mass.factors()
        if self.ties is not None:
            self.factors = self.factors._replace(ties=self.ties.factors(self.velocity))

    def place(self, displacement: Array) -> None:
        """Set the displacement of the added mass, a state vector."""
        self.mass.place(displacement[self.order])
        if self.mass.scaling > 0.0:
            self._factorise()

    def momenta(self, velocity: Array) -> Array:
        """Return mass times velocity, held degrees of freedom included, both state vectors."""
        result = np.empty_like(velocity)
        result[self.order] = self.mass.momenta(velocity[self.order])
        return result

    def settle(self) -> None:
        """Set the momenta to those of the velocity."""
        free = self.state.velocity.copy()
        free[self.state.held] = 0.0
        self.state.momenta[:] = self.momenta(free)
        self.state.momenta[self.state.held] = 0.0

    def velocity(self, momenta: Array, held: Array | float = 0.0) -> Array:
        """Return the velocity of momenta, both state vectors, with ``held`` at the held degrees of freedom."""
        result, own = np.zeros_like(momenta), momenta.copy()
        result[self.state.held] = held
        own[self.ranks.others] = 0.0
        eliminate(self.factors, own)
        all_sums(self.factors.call, self.factors.own, self.factors.all)
        divide(self.factors, result)
        return self.ranks.whole(result)

    def forces(
        self, displacement: Array, activation: float, time: float | None = None, mesh: Mesh | None = None
    ) -> tuple[Array, tuple[float, ...]]:
        """Return internal less contact and external forces, followed by those on facets, and sums; changes no state.

        Moving obstacles are at their positions at ``time``, or at the last ones; elements are those of another mesh if
        it is given.  The sums are those of `isorod.dynamics.explicit.contact_step_kernel.subtract`.
        """
        forces = np.empty_like(displacement)
        if internal_forces(mesh or self.mesh, displacement, activation, False, False, forces)[0] > 0.0:
            forces[:] = np.nan
        outside = 0.0 if self.drive is None else self.drive.forces(displacement)
        if self.contact is None:
            return self.ranks.sums(forces) - outside, (0.0,) * 8
        from isorod.contact.placing_kernel import place_obstacles
        from isorod.dynamics.explicit import contact_step_kernel

        if time is not None:
            place_obstacles(self.contact.packed, time)
        starts = self.contact.packed.starts.copy()
        self.contact.own[:] = 0.0
        if self.beyond.size:
            displacement, forces = np.append(displacement, self.beyond), np.append(forces, 0.0 * self.beyond)
        pressing = contact_step_kernel.subtract(self.contact, displacement, False, forces)
        self.contact.packed.starts[:] = starts
        energy, force, area, deepest, *sums = pressing
        deepest = self.ranks.smallest(deepest)
        total = self.ranks.sums(forces)
        total[: self.model.dofs] -= outside
        return total, (energy, force, area, deepest, *self.ranks.sums(np.array(sums)).tolist())

    def contact_forces(self) -> Array:
        """Return the normal force of each contact at the last `forces`, ``(contacts,)``."""
        if self.contact is None:
            return np.zeros(0)
        from isorod.contact.result import of_contacts

        packed = self.contact.packed
        loads = np.where(packed.own, packed.areas * packed.states["pressure"], 0.0)
        return self.ranks.sums(np.array([loads[there].sum() for _, _, there in of_contacts(self.model, packed)]))

    def obstacle_loads(self) -> Array:
        """Return force and moment of the obstacle of each contact at the last `forces`, ``(contacts, 6)``."""
        if self.contact is None:
            return np.zeros((0, 6))
        from isorod.contact import ranks, result

        packed, friction = self.contact.packed, self.contact.friction
        return result.loads_of(self.model, packed, friction, ranks.Ranks(self.ranks.communicator))

    def obstacle_work(self, begin: float, end: float) -> float:
        """Return the work of the obstacles between two times, with their forces at the last `forces`."""
        if self.contact is None or not self.contact.packed.tracks.size:
            return 0.0
        from isorod.contact import placing_kernel

        loads = np.zeros((self.contact.packed.passes.size, 6))
        placing_kernel.obstacle_loads(self.contact.packed, self.contact.friction, loads)
        work = placing_kernel.obstacle_work(self.contact.packed, loads, begin, end)
        return float(self.ranks.sums(np.array([work]))[0])

    def energies(self, displacement: Array) -> tuple[float, float, float]:
        """Return the stored energy without activation, that added by full activation, and the dissipation of laws."""
        own = internal_forces(self.mesh, displacement, 0.0, True, False, np.empty_like(displacement))
        _, stored, active, lost = self.ranks.sums(np.array(own)).tolist()
        return stored, active, lost

    def update_states(self, step: float) -> None:
        """Update laws with memory to the present displacement, at a time ``step`` after their last state."""
        if self.model.remembers:
            elapse(self.mesh, step)
            internal_forces(
                self.mesh, self.state.displacement, 0.0, False, True, np.empty_like(self.state.displacement)
            )
            elapse(self.mesh, 0.0)

    @property
    def states(self) -> Array:
        """States of laws with memory at all quadrature points, of all ranks."""
        return self.ranks.sums(states.of(self.model, self.ranks, self.mesh.fibres))

    def set_states(self, all_states: Array) -> None:
        """Set the states of laws with memory, as `states` returned them."""
        states.give(self.model, self.ranks, all_states, self.mesh.fibres)
        elapse(self.mesh, 0.0)

    def worst(self, displacement: Array) -> str:
        """Return a message on the most compressed element."""
        model = self.model
        everywhere = displacement[self.order]
        worst: list[tuple[float, str]] = []
        for elements in self.ranks.element_ranges:
            body, b = elements.body, elements.which
            table = body.space.tabulate(elements.first, elements.last)
            shape = (table.elements, body.space.axis.degree + 1, body.space.layer_nodes, 3)
            nodal = model.nodal(everywhere, b)[body.space.element_nodes[elements.first : elements.last]].reshape(shape)
            det = determinant(deformation_gradients(table, nodal))
            det = np.where(np.isfinite(det), det, -np.inf)
            e, t, _ = np.unravel_index(int(np.argmin(det)), det.shape)
            place = f"element {elements.first + e} of body {b} at u = {table.u[e, t]:.4g}"
            worst.append((float(det.min()), f"smallest det F = {det.min():.3g} in {place}"))
        return min(chain.from_iterable(self.ranks.gather(worst)))[1]

    def critical_step(self, displacement: Array, activation: float) -> float:
        """Return the critical time step of a state, ``2 / omega`` of the highest frequency; zero if elements invert.

        Lanczos iteration on ``M^-1 K``, symmetric in the inner product of ``M``, ``K`` by central differences of the
        forces, until the residual bounds the error of the frequency to half of ``_TOLERANCE``.  It starts near the
        mode of the last estimate.
        """
        free, mine, ranks = self.free, self._mine, self.ranks
        own = free[mine]
        count = min(free.size, _LANCZOS)
        # Orthonormal vectors, and the mass times each: of this rank's degrees of freedom.
        basis, momenta = np.zeros((count, mine.size)), np.zeros((count, mine.size))
        diagonal, beside = np.zeros(count), np.zeros(count)

        def dot(one: Array, other: Array) -> Array:
            return ranks.sums(np.atleast_1d(one @ other))

        # Fixed noise, so that runs are reproducible, with a part of each mode, in case another one is the highest now.
        noise = np.random.default_rng(0).standard_normal(free.size)
        image = np.zeros_like(displacement)
        image[free] = noise
        image[free] *= _MIXED / np.sqrt(noise @ self.velocity(image)[free])
        image[free] += self.highest
        vector = self.velocity(image)[own]
        size = np.sqrt(dot(vector, image[own])[0])
        trial = [displacement.copy(), displacement.copy()]
        # Laws with memory are stiffest without flow.
        stiff = self.mesh._replace(constants=self.mesh.stiff)
        highest = missing = 0.0
        for k in range(count):
            basis[k], momenta[k] = vector / size, image[own] / size
            step = 1e-5 * self._size / -ranks.smallest(-np.abs(basis[k]).max(initial=0.0))
            increment = np.zeros_like(displacement)
            increment[own] = step * basis[k]
            increment = ranks.sums(increment)[free]
            for sign, u in zip((1.0, -1.0), trial, strict=True):
                u[free] = displacement[free] + sign * increment
            ahead, behind = (self.forces(u, activation, mesh=stiff)[0] for u in trial)
            image[free] = (ahead - behind)[free] / (2.0 * step)
            if not np.isfinite(image).all():
                return 0.0
            diagonal[k] = dot(basis[k], image[own])[0]
            # Twice, because of rounding.
            for _ in range(2):
                image[own] -= dot(basis[: k + 1], image[own]) @ momenta[: k + 1]
            image = ranks.whole(image)
            vector = self.velocity(image)[own]
            beside[k] = size = np.sqrt(max(dot(vector, image[own])[0], 0.0))
            values, vectors = eigh_tridiagonal(diagonal[: k + 1], beside[:k])
            highest = float(values[-1])
            missing = beside[k] * abs(vectors[-1, -1])
            if missing <= _TOLERANCE * abs(highest):
                mode = np.zeros_like(displacement)
                mode[own] = vectors[:, -1] @ momenta[: k + 1]
                self.highest[:] = ranks.sums(mode)[free]
                break
        else:
            # An upper bound: rather too short a step.
            highest += missing
        return 2.0 / np.sqrt(highest) if highest > 0.0 else np.inf
