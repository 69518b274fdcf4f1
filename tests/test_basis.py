"""A section basis of another kind: one class, and statics, modes and both integrators take it."""

from dataclasses import dataclass

import numpy as np
import pytest
from conftest import straight

from isorod import Body, Contact, InputError, Model, NeoHookean, Plane, Space, Support, dynamics, modal, statics
from isorod.contact.operator import ContactOperator
from isorod.geometry.disk import harmonic_functions
from isorod.geometry.quadrature import Rule
from isorod.space.polyharmonic import Polyharmonic
from isorod.space.polynomial import Polynomials


@dataclass(frozen=True)
class Almansi:
    """``T_i`` and ``(1 - |xi|^2) T_i``: they span what polyharmonic functions of order 2 do (Almansi's theorem)."""

    n: int
    family = "Almansi's"
    on_surface = False

    @property
    def count(self):
        return 2 * self.n

    @property
    def is_control_point(self):
        return np.arange(self.count) < self.n

    def functions(self, xi):
        xi = np.asarray(xi, dtype=float)
        values, gradients = harmonic_functions(self.n, xi)
        bubble = 1.0 - np.sum(xi**2, axis=1)
        inner = bubble[:, None, None] * gradients - 2.0 * values[:, :, None] * xi[:, None, :]
        return np.hstack([values, bubble[:, None] * values]), np.concatenate([gradients, inner], axis=1)

    def positions(self, polygons):
        return np.concatenate([polygons, np.zeros_like(polygons)], axis=1)

    def auto(self, degree):
        return Rule(4, 2, degree + 1)

    def full(self, degree):
        return Rule.full(self.n, degree, 5)

    @property
    def pressure_count(self):
        return 6

    def pressures(self, xi):
        x, y = np.asarray(xi, dtype=float).T
        return np.stack([x**0, x, y, x * x, x * y, y * y], axis=1)


@pytest.fixture(params=["auto", "full"])
def spaces(request, cylinder):
    """The same space in two bases."""
    rod, common = cylinder(5, height=3.0), {"elements": 2, "degree": 3, "quadrature": request.param}
    return Space.paper(rod, order=2, **common), Space.paper(rod, section_basis=Almansi(5), **common)


def model(space, formulation="displacement"):
    law = NeoHookean(10.0, 0.3)
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.2, -0.1, 0.3))
    return Model([Body(space, law, 1.0, formulation)], ends)


@pytest.mark.parametrize("formulation", ["displacement", "mixed"])
def test_equilibrium_is_that_of_the_same_space_in_its_own_basis(spaces, formulation):
    expected, found = (statics.solve(model(space, formulation)) for space in spaces)
    assert found.reactions == pytest.approx(expected.reactions, abs=1e-8 * np.abs(expected.reactions).max())


def test_frequencies_are_those_of_the_same_space_in_its_own_basis(spaces):
    expected, found = (modal.solve(model(space), modes=6).frequencies for space in spaces)
    assert found == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize(("integrator", "step"), [("explicit", 1e-3), ("implicit", 0.1)])
def test_motion_is_that_of_the_same_space_in_its_own_basis(spaces, integrator, step):
    found = []
    for space in spaces:
        free = Model([Body(space, NeoHookean(10.0, 0.3), 1.0)], [Support.end(space, "start")])
        velocity = (space.is_control_point[:, None] * space.positions[:, 2:] * np.array([0.3, 0.1, -0.2])).ravel()
        run = dynamics.solve(free, 0.4, step, outputs=2, velocity=velocity, integrator=integrator)
        tip = space.displacement(run.displacement[-1], [[0.0, 0.0], [0.9, 0.1]], [space.axis.breaks[-1]])[0]
        found.append(tip)
    assert found[1] == pytest.approx(found[0], abs=1e-7 * np.abs(found[0]).max())


def test_contact_is_that_of_the_same_space_in_its_own_basis(spaces):
    """Control points that contact gives a basis which has none of its own are, where they can be, the same surface."""
    found = []
    plane = Plane((0.0, -0.9, 0.0), (0.0, 1.0, 0.0))
    for space, points in zip(spaces, ((32, 4), (8, 4)), strict=True):
        operator = ContactOperator(
            Model([Body(space, NeoHookean(1.0, 0.3))], contacts=[Contact(0, plane, 1.0, points=points)])
        )
        found.append(operator.forces(np.zeros(operator.model.dofs))[1])
    assert found[1] == pytest.approx(found[0], rel=1e-3)
    assert found[0] > 0.0


@pytest.mark.parametrize("other", [{"order": 2}, {"section_points": 10}, {"section_degree": 2}])
def test_other_section_functions_have_no_say(cylinder, other):
    with pytest.raises(InputError, match="section basis: it takes the place of"):
        _ = Space.paper(cylinder(5), section_basis=Almansi(5), **other).nodes


def basis_of(n, order, degree=None):
    return Polyharmonic(n, order) if degree is None else Polynomials(straight(n), degree)


@pytest.mark.parametrize(
    ("arguments", "degree", "rule"),
    [
        ((7, 1), 2, Rule(6, 6, 4)),
        ((8, 1), 2, Rule(6, 4, 4)),
        ((16, 3), 3, Rule(6, 4, 5)),
        ((16, 4), 3, Rule(7, 4, 5)),
        ((16, 1, 4), 3, Rule(6, 4, 5)),
        ((16, 1, 5), 3, Rule(7, 4, 5)),
    ],
)
def test_full_rule(arguments, degree, rule):
    """``max(6, K + 3)``, or ``max(6, N + 2)``, radial points; fewer angular ones where slices are many."""
    assert basis_of(*arguments).full(degree) == rule


@pytest.mark.parametrize(
    ("arguments", "degree", "rule"),
    [
        ((8, 1), 2, Rule(3, 2, 3)),
        ((32, 2), 3, Rule(4, 2, 4)),
        # Beyond 32 control points 0.87 sqrt(n) radial points, to the next one.
        ((33, 2), 3, Rule(5, 2, 4)),
        ((64, 2), 3, Rule(7, 2, 4)),
        ((65, 2), 3, Rule(8, 2, 4)),
        # Polynomials: S = 1 for N <= 3, 2 for N = 4, 3 above; more where slices are few.
        ((16, 1, 2), 2, Rule(3, 1, 3)),
        ((16, 1, 3), 2, Rule(3, 1, 3)),
        ((16, 1, 4), 2, Rule(4, 2, 3)),
        ((16, 1, 5), 2, Rule(5, 3, 3)),
        ((4, 1, 3), 2, Rule(3, 5, 3)),
        ((8, 1, 6), 2, Rule(6, 5, 3)),
    ],
)
def test_auto_rule(arguments, degree, rule):
    assert basis_of(*arguments).auto(degree) == rule
