"""A model as the compiled loops of explicit dynamics take it: plain arrays, and state vectors in their own order."""

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh_tridiagonal

from isorod.arrays import Array
from isorod.assembly import element_kernel
from isorod.dynamics.explicit import step_kernel
from isorod.dynamics.explicit.cholesky import solve
from isorod.dynamics.explicit.element_kernel import internal_forces
from isorod.dynamics.explicit.mass import Mass
from isorod.dynamics.explicit.mesh import GEOMETRY, POINTS, order, pack
from isorod.dynamics.explicit.step_kernel import Course, State
from isorod.model.model import Model
from isorod.tensors import determinant

if TYPE_CHECKING:
    from isorod.contact.friction_kernel import Friction
    from isorod.contact.packed import Table
    from isorod.dynamics.explicit.contact import StepContact

# Relative accuracy of the highest eigenvalue, and the most iterations spent on it.
_TOLERANCE = 1e-3
_LANCZOS = 100
_MIXED = 0.05


class System:
    """A model in motion: its compiled arrays, the state, and what can be asked of both.

    Parameters
    ----------
    model
        Bodies with densities, supports, contacts.

    Attributes
    ----------
    mass, factors
        The mass, and what steps divide by it; see `scale`.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.mesh = pack(model)
        self.order = order(model)
        self.free = self.order[model.free >= 0]
        self.mass = Mass(model, self.order)
        self.factors = self.mass.factors()
        self.state = State(
            displacement=np.zeros(model.dofs),
            velocity=np.zeros(model.dofs),
            momenta=np.zeros(model.dofs),
            forces=np.zeros(model.dofs),
            held=self.order[model.held].astype(np.uint64),
            impulse=np.zeros(model.held.size),
            sums=np.zeros(5),
        )
        # Momenta of the highest frequency found last.
        self.highest = np.zeros(self.free.size)
        # The smallest size of a quadrature point's surroundings, for finite differences.
        volumes = self.mesh.geometry.reshape(-1, GEOMETRY, POINTS)[:, 9]
        self._size = float(volumes[volumes > 0.0].min()) ** (1.0 / 3.0)
        self.contact: StepContact | None = None
        if model.contacts:
            from isorod.dynamics.explicit import contact

            self.contact = contact.pack(model, self.order)
        self.friction: Friction | None = None
        if self.contact is not None and any(one.friction for one in model.contacts):
            from isorod.contact import friction

            self.friction = friction.pack(model, self.contact.packed)

    @property
    def starts(self) -> Array:
        """Start values of the closest-point searches: all that contact without friction remembers."""
        return np.empty(0) if self.contact is None else self.contact.packed.starts

    @property
    def anchors(self) -> Array:
        """What friction remembers."""
        return np.empty(0) if self.friction is None else self.friction.anchors

    @property
    def contact_data(self) -> "tuple[Array | Table, ...]":
        """What does not change of the contacts."""
        rubbing = () if self.friction is None else (self.friction.coefficients,)
        return () if self.contact is None else (*self.contact.packed.fixed, *self.contact.faces, *rubbing)

    def advance(self, course: Course, first: int, last: int) -> tuple[int, int]:
        """Take steps ``first`` to ``last - 1``; return as `isorod.dynamics.explicit.step_kernel.advance` does."""
        if self.contact is None:
            return step_kernel.advance(self.mesh, self.state, self.factors, course, first, last)
        if self.friction is not None:
            from isorod.dynamics.explicit import friction_step_kernel

            given = (self.mesh, self.state, self.factors, course, first, last, self.contact, self.friction)
            return friction_step_kernel.advance(*given)
        from isorod.dynamics.explicit import contact_step_kernel

        return contact_step_kernel.advance(self.mesh, self.state, self.factors, course, first, last, self.contact)

    def scale(self, scaling: float) -> None:
        """Add mass; see `isorod.dynamics.explicit.mass`."""
        if scaling == self.mass.scaling:
            return
        self.mass.scaling = scaling
        self.factors = self.mass.factors()

    def momenta(self, velocity: Array) -> Array:
        """Return mass times velocity, held degrees of freedom included, both state vectors."""
        result = np.empty_like(velocity)
        result[self.order] = self.mass.momenta(velocity[self.order])
        return result

    def velocity(self, momenta: Array) -> Array:
        """Return the velocity that belongs to momenta, both state vectors; zero where held."""
        result = np.zeros_like(momenta)
        solve(self.factors, momenta, result)
        return result

    def forces(self, displacement: Array, activation: float) -> tuple[Array, tuple[float, ...]]:
        """Return internal less contact forces, and what `contact_step_kernel.subtract` says; changes no state."""
        forces = np.empty_like(displacement)
        if internal_forces(self.mesh, displacement, activation, False, forces)[0] > 0.0:
            forces[:] = np.nan
        if self.contact is None:
            return forces, (0.0,) * 8
        starts = self.starts.copy()
        if self.friction is None:
            from isorod.dynamics.explicit import contact_step_kernel

            said = contact_step_kernel.subtract(self.contact, displacement, forces)
        else:
            from isorod.dynamics.explicit import friction_step_kernel

            said = friction_step_kernel.subtract(self.contact, self.friction, displacement, False, forces)
        self.starts[:] = starts
        return forces, said

    def energies(self, displacement: Array) -> tuple[float, float]:
        """Return the stored energy without activation, and what full activation adds."""
        _, stored, active = internal_forces(self.mesh, displacement, 0.0, True, np.empty_like(displacement))
        return stored, active

    def worst(self, displacement: Array) -> str:
        """Return which element is the most compressed."""
        model = self.model
        everywhere = displacement[self.order]
        found: list[tuple[float, str]] = []
        for b, body in enumerate(model.bodies):
            table = body.space.tabulate(0, body.space.axis.elements)
            shape = (table.elements, body.space.axis.degree + 1, body.space.layer_nodes, 3)
            nodal = model.nodal(everywhere, b)[body.space.element_nodes].reshape(shape)
            F = element_kernel.deformation_gradients(table, nodal)
            det = determinant(F)
            det = np.where(np.isfinite(det), det, -np.inf)
            e, t, _ = np.unravel_index(int(np.argmin(det)), det.shape)
            where = f"element {e} of body {b} at u = {table.u[e, t]:.4g}"
            found.append((float(det.min()), f"smallest det F = {det.min():.3g} in {where}"))
        return min(found)[1]

    def critical_step(self, displacement: Array, activation: float) -> float:
        """Return the largest stable step about a state, ``2 / omega`` of the highest frequency; zero if it cannot be.

        Lanczos iteration on ``M^-1 K``, symmetric in the inner product of ``M``, ``K`` by central differences of the
        forces, until the residual bounds the error of the frequency to half of ``_TOLERANCE``.  It starts near the last
        vector found.
        """
        free = self.free
        count = min(free.size, _LANCZOS)
        # Orthonormal vectors, and the mass times each.
        basis, momenta = np.zeros((count, free.size)), np.zeros((count, free.size))
        diagonal, beside = np.zeros(count), np.zeros(count)
        # A fixed start, so that a run is the same each time; something of every vector is in it, should another be the
        # highest now.
        noise = np.random.default_rng(0).standard_normal(free.size)
        image = np.zeros_like(displacement)
        image[free] = noise
        image[free] *= _MIXED / np.sqrt(noise @ self.velocity(image)[free])
        image[free] += self.highest
        vector = self.velocity(image)[free]
        size = np.sqrt(vector @ image[free])
        trial = [displacement.copy(), displacement.copy()]
        highest = missing = 0.0
        for k in range(count):
            basis[k], momenta[k] = vector / size, image[free] / size
            step = 1e-5 * self._size / np.abs(basis[k]).max()
            for sign, u in zip((1.0, -1.0), trial, strict=True):
                u[free] = displacement[free] + sign * step * basis[k]
            ahead, behind = (self.forces(u, activation)[0] for u in trial)
            image[free] = (ahead - behind)[free] / (2.0 * step)
            if not np.isfinite(image).all():
                return 0.0
            diagonal[k] = basis[k] @ image[free]
            # Twice: once leaves what rounding brings back.
            for _ in range(2):
                image[free] -= (basis[: k + 1] @ image[free]) @ momenta[: k + 1]
            vector = self.velocity(image)[free]
            beside[k] = size = np.sqrt(max(vector @ image[free], 0.0))
            values, vectors = eigh_tridiagonal(diagonal[: k + 1], beside[:k])
            highest = float(values[-1])
            missing = beside[k] * abs(vectors[-1, -1])
            if missing <= _TOLERANCE * abs(highest):
                self.highest[:] = vectors[:, -1] @ momenta[: k + 1]
                break
        else:
            # Rather too short a step than too long a one.
            highest += missing
        return 2.0 / np.sqrt(highest) if highest > 0.0 else np.inf
