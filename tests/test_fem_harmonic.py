"""The paper's blade on a shaker beside finite elements: a complex solve of all of their unknowns at resonance."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

import ufl
from dolfinx import fem
from dolfinx.fem import petsc as assembling
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from comparisons.fem.domain import Domain
from comparisons.fem.modal import free_unknowns
from isorod import Body, LinearElastic, Model, Space, Support, harmonic
from isorod.fenics import compat
from isorod.fenics.flags import FAST
from isorod.scenes.blade import Blade
from isorod.space import choice
from meshes import blade
from meshes.inverse import parameters

ETA = 0.04

# Where quadratic bricks have their best stresses.
GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)


def stress_of(u, scene):
    """Return Hooke's stress as an expression."""
    shear = scene.E / (2.0 * (1.0 + scene.nu))
    lame = scene.E * scene.nu / ((1.0 + scene.nu) * (1.0 - 2.0 * scene.nu))
    strain = ufl.sym(ufl.grad(u))
    return 2.0 * shear * strain + lame * ufl.tr(strain) * ufl.Identity(3)


def matrix(form):
    """Return the matrix of a form."""
    found = assembling.assemble_matrix(fem.form(form))
    found.assemble()
    first, column, values = found.getValuesCSR()
    return csc_array((values, column, first), shape=found.getSize()).T


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:natural frequencies are right")
@pytest.mark.parametrize("resonance", [0, 1])
def test_stress_of_the_blade_at_resonance_is_that_of_finite_elements(resonance):
    scene, rod = Blade(), Blade().rod()
    # As of a file that measures stresses.
    knots = choice.boundary_layers(rod, None, (), 0.0, choice.layer(rod, 0.0, False))
    space = Space(rod, **choice.stressed(rod, 0.0), knots=knots)
    model = Model([Body(space, LinearElastic(scene.E, scene.nu), scene.density)], [Support.end(space, "start")])
    found = harmonic.solve(model, harmonic.Span(0.05, 1.0, 50), harmonic.Damping(structural=ETA), base=(0.0, 1.0, 0.0))
    k = int(np.argmin(np.abs(found.frequencies - found.resonances[resonance])))
    domain = Domain.distribute(blade.build("bricks", along=20, across=2, layers=32, grading=1.3))
    space = compat.function_space(domain.mesh, compat.element(domain.mesh, "Lagrange", 2, 3))
    u, v, state = ufl.TrialFunction(space), ufl.TestFunction(space), fem.Function(space)
    dx = ufl.dx(metadata={"quadrature_degree": 5})
    stiffness = matrix(ufl.inner(stress_of(u, scene), ufl.sym(ufl.grad(v))) * dx)
    mass = matrix(scene.density * ufl.inner(u, v) * dx)
    free = (3 * free_unknowns(space, domain, ["start"], True)[:, None] + np.arange(3)).ravel()
    shaken = np.tile([0.0, 1.0, 0.0], stiffness.shape[0] // 3)
    omega = 2.0 * np.pi * found.frequencies[k]
    system = ((1.0 + 1j * ETA) * stiffness - omega**2 * mass)[free][:, free]
    moved = np.zeros(stiffness.shape[0], dtype=complex)
    moved[free] = splu(system.tocsc()).solve(-(mass @ shaken)[free].astype(complex))
    lattice = np.stack([one.ravel() for one in np.meshgrid(GAUSS, GAUSS, GAUSS)], axis=1)
    values = ufl.as_vector([*ufl.SpatialCoordinate(domain.mesh), *ufl.as_vector(list(flat(stress_of(state, scene))))])
    evaluate = compat.expression(values, lattice, FAST)
    cells = np.arange(domain.mesh.topology.index_map(3).size_local, dtype=np.int32)
    parts = []
    for part in (moved.real, moved.imag):
        state.x.array[:] = part
        parts.append(evaluate(domain.mesh, cells).reshape(-1, 12))
    points = parts[0][:, :3]
    theirs = found.amplitude((parts[0] + 1j * parts[1])[:, 3:].reshape(-1, 3, 3), "von_mises", np.empty(0))
    # Away from the clamp; the highest.
    theirs[points[:, 2] < 0.8] = 0.0
    highest = np.argsort(theirs)[-100::5]
    rod = found.model.bodies[0].space.rod
    where, _ = parameters(rod, points[highest])
    one = found.single(k)
    ours = [one.amplitude(one.stress(0, u, xi), "von_mises", np.empty(0)) for *xi, u in where]
    assert np.array(ours) == pytest.approx(theirs[highest], rel=1e-2)


def flat(tensor):
    """Yield the components of a tensor."""
    yield from (tensor[i, j] for i in range(3) for j in range(3))
