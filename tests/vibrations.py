"""What the tests of vibration modes share: bars, their matrices, and what a mode does."""

import numpy as np
from conftest import as_array
from petsc4py import PETSc

from isorod.assembly.assembler import Assembler
from isorod.material import LinearElastic
from isorod.model import Body, Model, Support
from isorod.scenes.blade import Blade
from isorod.scenes.flower import Flower
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring
from isorod.space import Space

E, RHO = 200.0, 2.0
SPEED = np.sqrt(E / RHO)


def clamped(space):
    return [Support.end(space, "start")]


def sliding(space):
    """End faces that stay in their planes and are free of shear."""
    return [Support.end(space, end, "z") for end in ("start", "end")]


def bars(cylinder):
    """Return a function that makes a model of a circular bar along z."""

    def make(length, held=lambda space: [], nu=0.3, radius=1.0, n=4, elements=8, degree=4, density=RHO, **more):
        rod = cylinder(n, height=length, radius=radius)
        space = Space.paper(rod, elements=elements, degree=degree, **more)
        return Model([Body(space, LinearElastic(E, nu), density)], held(space))

    return make


def matrices(model, lumped=False):
    """Return stiffness and mass of the unknowns, dense."""
    assembler = Assembler(model, PETSc.COMM_SELF)
    stiffness = assembler.matrix()
    assembler.tangent(assembler.vector(), 0.0, stiffness)
    return [as_array(matrix) for matrix in (stiffness, assembler.mass(lumped))]


def rates(modes):
    """Return the angular frequencies, rigid modes left out."""
    return 2.0 * np.pi * modes.frequencies[modes.rigid :]


def share(modes, field):
    """Return how much of each mode but rigid ones is in every layer of nodes a multiple of ``field`` (0 to 1)."""
    space = modes.model.bodies[0].space
    moved = modes.vectors[modes.rigid :].reshape(-1, space.layers, 3 * space.layer_nodes)
    field = np.where(space.is_carrier[:, None], field, 0.0).reshape(space.layers, -1)
    field /= np.linalg.norm(field, axis=1)[:, None]
    return (np.einsum("mja,ja->mj", moved, field) ** 2).sum(axis=1) / (moved**2).sum(axis=(1, 2))


def turning(modes):
    """Return the share of each mode that turns sections about z."""
    x, y, z = modes.model.bodies[0].space.positions.T
    return share(modes, np.stack([-y, x, 0 * z], axis=1))


def stretching(modes):
    """Return the share of each mode that moves sections along z."""
    return share(modes, np.array([0.0, 0.0, 1.0]))


def mac(a, b):
    """Return the modal assurance criterion of the rows of two arrays."""
    return (a @ b.T) ** 2 / np.outer((a * a).sum(axis=1), (b * b).sum(axis=1))


def bending(modes):
    """Return angular frequencies of the bending modes, having made sure that they come in pairs."""
    omega = rates(modes)[(turning(modes) < 1e-6) & (stretching(modes) < 1e-6)]
    omega = omega[: omega.size // 2 * 2].reshape(-1, 2)
    # Rounding: 1e-16 of the largest eigenvalue, 1e8 times the first one of the most slender bar here.
    assert np.abs(omega[:, 1] / omega[:, 0] - 1.0).max() < 1e-8
    return omega[:, 0]


def free_model(rod, **refinement):
    return Model([Body(Space.paper(rod, **refinement), LinearElastic(E, 0.3), RHO)])


FREE = {
    "straight": lambda bar: bar(6.0, degree=3),
    "slender": lambda bar: bar(60.0),
    "order 2": lambda bar: bar(6.0, order=2, elements=4),
    "helix": lambda bar: free_model(Spring(section_points=4).rod(), elements=12, degree=3),
    "slender helix": lambda bar: free_model(Spring(section_points=4, wire_radius=0.1).rod(), elements=24, degree=3),
    "ring": lambda bar: free_model(Ring(section_points=6).rod(), elements=8, degree=3),
    "flower": lambda bar: free_model(Flower().rod(), elements=4, quadrature="full"),
    "blade": lambda bar: Model(Blade(preset="paper", elements=6).model().bodies),
}
