"""What the tests of vibration modes share: bars, their matrices, and what a mode does."""

import numpy as np
from conftest import as_array
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import Legendre, leggauss
from petsc4py import PETSc
from scipy.linalg import eig
from scipy.optimize import brentq

from isorod import Body, LinearElastic, Model, Space, Support
from isorod.assembly.assembler import Assembler
from isorod.scenes.blade import Blade
from isorod.scenes.flower import Flower
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring

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
    field = np.where(space.is_control_point[:, None], field, 0.0).reshape(space.layers, -1)
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


def ritz(count, edge, length=1.0):
    """Return points and weights along a beam, and a table of derivatives of polynomials times ``edge``."""
    x, weight = leggauss(40)
    x, weight = 0.5 * length * (x + 1.0), 0.5 * length * weight
    domain = [0.0, length]
    basis = [Polynomial(edge) * Legendre.basis(j, domain=domain).convert(kind=Polynomial) for j in range(count)]
    return x, weight, lambda k: np.array([one.deriv(k)(x) if k else one(x) for one in basis])


def quadratic(K, G, M):
    """Return all ``s`` of ``K + s G + s^2 M``."""
    one, zero = np.eye(len(K)), np.zeros_like(K)
    return eig(np.block([[zero, one], [-K, -G]]), np.block([[one, zero], [zero, M]]))[0]


def wave(missed, force, length, bending, mass, low, high):
    """Return the frequency of a beam under tension between two multiples of pi / length, by what its ends miss.

    Of bending, EI times the fourth derivative of w, and tension: k^2 is the wave's, k^2 + T / EI the edges'.
    """

    def edges(k):
        return np.sqrt(k * k + force / bending)

    k = brentq(lambda k: missed(k * length, edges(k) * length), low * np.pi / length, high * np.pi / length)
    return np.sqrt((bending * k**4 + force * k**2) / mass) / (2.0 * np.pi)


def pinned(force, length, bending, mass, n=1):
    """Clamped at one end and pinned at the other: k1 tan(k2 l) = k2 tanh(k1 l)."""
    missed = lambda k, w: w * np.sin(k) - k * np.cos(k) * np.tanh(w)  # noqa: E731
    return wave(missed, force, length, bending, mass, n + 0.001, n + 0.499)


def fixed(force, length, bending, mass):
    """Clamped at both ends."""
    missed = lambda k, w: k * np.sin(0.5 * k) + w * np.tanh(0.5 * w) * np.cos(0.5 * k)  # noqa: E731
    return wave(missed, force, length, bending, mass, 1.001, 1.999)


def free_model(rod, **refinement):
    return Model([Body(Space.paper(rod, **refinement), LinearElastic(E, 0.3), RHO)])


FREE = {
    "straight": lambda bar: bar(6.0, degree=3),
    "slender": lambda bar: bar(60.0),
    "order 2": lambda bar: bar(6.0, order=2, elements=4),
    "polynomials": lambda bar: bar(6.0, section_degree=4, elements=4),
    "helix": lambda bar: free_model(Spring(helix="paper", section_points=4).rod(), elements=12, degree=3),
    "slender helix": lambda bar: free_model(
        Spring(helix="paper", section_points=4, wire_radius=0.1).rod(), elements=24, degree=3
    ),
    "ring": lambda bar: free_model(Ring(section_points=6).rod(), elements=8, degree=3),
    "flower": lambda bar: free_model(Flower().rod(), elements=4, quadrature="full"),
    "blade": lambda bar: Model(Blade(preset="paper", elements=6).model().bodies),
}
