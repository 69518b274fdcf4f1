"""A shaft that is let go in a hub too narrow for it: the pressure as it swings, by elements along the radius."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from conftest import straight
from dolfinx import fem
from surfaces import DELTA, FIT, HUB, OUTER, SHAFT

from comparisons.joints.lattice import circle, ring
from comparisons.joints.sleeve import pinned
from isorod import Space, dynamics
from isorod.fenics import compat
from isorod.fenics.solid import Solid
from isorod.model import Body, Contact, Model, Support
from isorod.model.tie import SolidSurface

LENGTH, PENALTY = 2.0, 1e3


def fitted():
    """Return both in plane strain."""
    made = ring(FIT, circle(OUTER), LENGTH, (2, 24, 1), "hexahedron", 2)
    space = compat.function_space(made.mesh, compat.element(made.mesh, "Lagrange", 2, 3))
    part = space.sub(2)
    own, _ = compat.collapsed(part)
    along = fem.locate_dofs_geometrical((part, own), lambda x: x[2] > -1.0)
    hub = Solid(space, HUB, 1.0, [*pinned(space, OUTER), fem.dirichletbc(fem.Function(own), along, part)])
    shaft = Space(straight(8, radius=FIT + DELTA, height=LENGTH), elements=1, degree=2, section_degree=4)
    contact = Contact(0, SolidSurface(0, made.hole), PENALTY, points=(8, 8))
    supports = [Support(np.arange(shaft.nodes), "z")]
    return Model([Body(shaft, SHAFT, 1.0)], supports, contacts=[contact], solids=[hub])


def along_radius(law, inner, outer, count=20):
    """Return stiffness and mass of quadratic elements along the radius, of an angle and a length of one."""
    r = np.linspace(inner, outer, 2 * count + 1)
    stiffness, mass = np.zeros((2, r.size, r.size))
    lame, mu = law.E * law.nu / ((1.0 + law.nu) * (1.0 - 2.0 * law.nu)), 0.5 * law.E / (1.0 + law.nu)
    moduli = np.array([[lame + 2.0 * mu, lame], [lame, lame + 2.0 * mu]])
    for e in range(count):
        own = slice(2 * e, 2 * e + 3)
        half = 0.5 * (r[2 * e + 2] - r[2 * e])
        for t, weight in zip(*np.polynomial.legendre.leggauss(4), strict=True):
            values = np.array([0.5 * t * (t - 1.0), 1.0 - t * t, 0.5 * t * (t + 1.0)])
            place = values @ r[own]
            strains = np.stack([np.array([t - 0.5, -2.0 * t, t + 0.5]) / half, values / place])
            stiffness[own, own] += weight * half * place * strains.T @ moduli @ strains
            mass[own, own] += weight * half * place * np.outer(values, values)
    return stiffness, mass


def pressures(times, steps):
    """Return the pressure in the joint, by so many trapezoidal steps between times, none of which opens it."""
    (k1, m1), (k2, m2) = along_radius(SHAFT, 0.0, FIT + DELTA), along_radius(HUB, FIT, OUTER)
    size = len(k1)
    stiffness, mass = np.zeros((2, size + len(k2), size + len(k2)))
    for whole, one, other in ((stiffness, k1, k2), (mass, m1, m2)):
        whole[:size, :size], whole[size:, size:] = one, other
    apart = np.zeros(len(mass))
    apart[size - 1 : size + 1] = -1.0, 1.0
    stiffness += PENALTY * FIT * np.outer(apart, apart)
    # The axis stays where it is.
    stiffness, mass, apart = stiffness[1:, 1:], mass[1:, 1:], apart[1:]
    dt, push = (times[1] - times[0]) / steps, PENALTY * FIT * DELTA * apart
    inverse = np.linalg.inv(mass + 0.25 * dt**2 * stiffness)
    moved, speed = np.zeros((2, len(mass)))
    rate, found = np.linalg.solve(mass, push), [PENALTY * DELTA]
    for k in range(steps * (len(times) - 1)):
        ahead = moved + dt * speed + 0.25 * dt**2 * rate
        after = inverse @ (push - stiffness @ ahead)
        moved, speed, rate = ahead + 0.25 * dt**2 * after, speed + 0.5 * dt * (rate + after), after
        if (k + 1) % steps == 0:
            found.append(PENALTY * (DELTA - apart @ moved))
    return np.array(found)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:time step")
def test_a_shaft_let_go_in_a_narrow_hub_swings_as_elements_along_the_radius():
    """With a penalty so low that the joint swings slower than waves cross both."""
    times = np.linspace(0.0, 0.15, 16)
    exact = pressures(times, 100)
    # It swings, and stays closed.
    assert 0.0 < exact.min() < 0.7 * exact.max()
    assert pressures(times, 50) == pytest.approx(exact, abs=2e-3 * exact.max())
    found = dynamics.solve(fitted(), times[-1], times[-1] / 60, outputs=15, integrator="implicit")
    pressure = found.contact_force / (2.0 * np.pi * FIT * LENGTH)
    assert pressure == pytest.approx(exact, abs=0.02 * exact.max())
    assert np.sqrt(np.mean((pressure - exact) ** 2)) < 0.01 * exact.max()
    assert np.abs(found.energy_error).max() < 1e-6
