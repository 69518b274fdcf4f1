"""Residual, tangent and energy of whatever is assembled: each is the derivative of the other, with pressures too."""

import numpy as np
import pytest
from conftest import as_array, straight
from models import MIXED, MODELS, PIPES, spinning
from petsc4py import PETSc
from test_laws import LAWS

from isorod import Body, Model, Space, Support
from isorod.assembly.formulation import assembler_for

FACTOR = 0.7


def of_law(name, formulation):
    space = Space.paper(straight(4), elements=2, degree=2, order=2)
    return Model([Body(space, LAWS[name], formulation=formulation)], [Support.end(space, "start")])


ENERGIES = ("MooneyRivlin", "Yeoh", "Gent", "Ogden", "HolzapfelGasserOgden", "of two families", "dispersed")
RODS = {
    f"{name}, {form}": lambda name=name, form=form: of_law(name, form)
    for name in ENERGIES
    for form in ("displacement", "mixed")
}
# Follower forces have no energy here.
CONSERVATIVE = MODELS | {"spinning fast": lambda: spinning(1.0)} | MIXED
ALL = CONSERVATIVE | PIPES | RODS
# Supports alone bring the load.
HELD = ["spring", "paper rule", "ring", "two bodies"]


def each(names):
    """Each law is compiled, for some seconds, where no other run has left it: two of them stand for all."""
    slow = [name for name in RODS if not name.startswith(("Ogden", "HolzapfelGasserOgden"))]
    values = [pytest.param(name, marks=pytest.mark.slow) if name in slow else name for name in names]
    return pytest.mark.parametrize("name", values)


def deformed(name):
    """An assembler, and a state of it."""
    assembler = assembler_for(ALL[name](), PETSc.COMM_SELF)
    noise = np.random.default_rng(0).uniform(-1, 1, assembler.vector().getSize())
    pull = [0.0, 0.0, 0.2] if name in RODS else None
    if name.startswith("mixed Muscle"):
        pull = [0.07 / 3.0, 0.14 / 3.0, 0.07]
    if pull:
        # So that no fibre is where it begins to bear.
        height = assembler.model.bodies[0].space.positions[:, 2]
        return assembler, moved(assembler.state(np.outer(height, pull).ravel()), 0.002 * noise)
    return assembler, moved(assembler.vector(), (1e-3 if name in PIPES else 0.03) * noise)


def moved(x, step):
    result = x.duplicate()
    result.array[:] = x.array_r + step
    return result


def residual(assembler, x, factor=FACTOR):
    out = assembler.vector()
    assembler.residual(x, factor, out)
    return out.array_r.copy()


def difference(f, h=1e-4):
    """Of sixth order."""
    return sum(w * (f(k * h) - f(-k * h)) for k, w in enumerate((3 / 4, -3 / 20, 1 / 60), 1)) / h


def energy(assembler, x, factor=FACTOR):
    """What is stored, and the potential of loads and of centrifugal forces, -f / 2 int rho |w x r|^2, by points."""
    model, u = assembler.model, assembler.displacement(x, factor)
    total = assembler.energy(x, factor) - factor * (model.external @ u)
    for b, body in enumerate(model.bodies if model.spin else ()):
        space, table = body.space, body.space.tabulate(0, body.space.axis.elements)
        for at, weights in zip(table.u, table.weights, strict=True):
            points = space.rod.grid(table.xi, at)[0] + space.displacement(model.nodal(u, b), table.xi, at)[0]
            speed = np.cross(np.array(model.spin.velocity), points - np.array(model.spin.center))
            total -= 0.5 * factor * float(body.density) * np.sum(weights * np.sum(speed**2, axis=2))
    return total


@each(ALL)
def test_tangent_is_symmetric_and_the_derivative_of_the_residual(name):
    assembler, x = deformed(name)
    matrix = assembler.matrix()
    assembler.tangent(x, FACTOR, matrix)
    dense = as_array(matrix)
    assert np.abs(dense - dense.T).max() < (1e-9 if name in PIPES else 1e-14) * np.abs(dense).max()
    for k in range(0, len(dense), 7):
        column = np.eye(1, len(dense), k)[0]
        expected = difference(lambda t, v=column: residual(assembler, moved(x, t * v)))
        assert np.linalg.norm(dense[:, k] - expected) < 1e-7 * np.linalg.norm(expected), k


@each(CONSERVATIVE)
def test_residual_is_the_gradient_of_the_energy(name):
    assembler, x = deformed(name)
    force, rng = residual(assembler, x), np.random.default_rng(1)
    for _ in range(3):
        v = rng.normal(size=force.size)
        v /= np.abs(v).max()
        slope = difference(lambda t, v=v: energy(assembler, moved(x, t * v)), 1e-3)
        assert slope == pytest.approx(force @ v, rel=1e-8, abs=1e-8 * np.linalg.norm(force))


@each(HELD)
def test_reactions_are_the_gradient_of_the_energy_by_the_support_displacements(name):
    assembler, x = deformed(name)
    forces = assembler.reactions(x, FACTOR)
    assert forces.shape == assembler.model.held.shape
    slope = difference(lambda t: assembler.energy(x, FACTOR + t), 1e-3)
    assert slope == pytest.approx(forces @ assembler.model.values, rel=1e-8)


@each(MODELS | PIPES | {"spinning fast": None} | MIXED)
def test_load_forces_are_the_derivative_of_the_residual_by_the_load_factor(name):
    assembler, x = deformed(name)
    out = assembler.vector()
    assembler.load_forces(x, FACTOR, 1e-6, out)
    expected = 1e-6 * difference(lambda t: residual(assembler, x, FACTOR + t), 1e-3)
    assert np.linalg.norm(out.array_r - expected) < 1e-6 * np.linalg.norm(expected)
