"""Bonds that follow a law of traction over slip: forces, tangents, pulled rods, modes, ranks, and bad input."""

import numpy as np
import pytest
from refused import refused
from scipy.integrate import solve_bvp

from isorod import LinearElastic, NeoHookean, Space, TransverselyIsotropic, circle, dynamics, modal, statics, straight
from isorod.assembly.formulation import assembler_for
from isorod.errors import SolveError
from isorod.model import Body, Model, SectionLoad, Support
from isorod.model.bond import BondLaw
from isorod.model.tie import EndFace, LateralSurface, SolidSurface, Tie

# Up to a peak, down, and along.
LAW = [(0.0, 0.0), (0.1, 2.0), (0.3, 0.5), (0.4, 0.5)]
RIGID = LinearElastic(1e8, 0.0)


def traction(slip):
    return np.interp(slip, *np.transpose(LAW))


def bar(length, z=0.0, radius=1.0, rings=None, n=8, **space):
    rod = straight(length, start=(0.0, 0.0, z)).sweep(circle(n, radius))
    return Space(rod if rings is None else rod.with_rings(rings), **{"section_degree": 2} | space)


def in_hole(length, material, bond=LAW, radius=0.5, **space):
    """Return a rod bonded over its length in a hole that is held everywhere, and what holds that."""
    rod = bar(length, radius=radius, **space)
    hole = bar(length, radius=2.0 * radius, rings=(0.5, 1.0), elements=1)
    tie = Tie(LateralSurface(0), LateralSurface(1, surface="inner"), kind="slide", bond=bond)
    return [Body(rod, material), Body(hole, RIGID)], [Support(np.arange(hole.nodes), body=1)], tie


def on_floor(bond=LAW, material=RIGID, **body):
    """Return a disk that slides on a bar, which is held everywhere."""
    floor, disk = bar(1.0), bar(0.5, 1.0, elements=1)
    tie = Tie(EndFace(1, "start"), EndFace(0, "end"), kind="slide", bond=bond)
    bodies = [Body(floor, material, **body), Body(disk, material, **body)]
    return bodies, [Support(np.arange(floor.nodes))], tie


def test_the_law_is_straight_between_its_points():
    law, slips = BondLaw(LAW), np.linspace(0.0, 0.7, 141)
    secant, tangent, energy = law.at(slips)
    assert secant * slips == pytest.approx(traction(slips), abs=1e-15)
    assert secant[0] == tangent[0] == 20.0
    exact = [
        np.sum(0.5 * (traction(s[1:]) + traction(s[:-1])) * np.diff(s))
        for s in (np.linspace(0.0, one, 7001) for one in slips)
    ]
    assert energy == pytest.approx(exact, abs=1e-6)
    assert [one[0] for one in BondLaw(3.0).at(np.array([0.4]))] == pytest.approx([3.0, 3.0, 0.24])


@pytest.mark.parametrize("turned", [False, True])
def test_forces_and_tangent_are_derivatives_of_the_energy(turned):
    """Of a rod in a sleeve, the rod or the sleeve as the slave, slips on all branches; so is the change by loads."""
    rod, sleeve = bar(2.0, radius=0.5, elements=2), bar(2.0, radius=1.0, rings=(0.5, 1.0), elements=1)
    sides = LateralSurface(0), LateralSurface(1, surface="inner")
    tie = Tie(*(sides[::-1] if turned else sides), kind="slide", bond=LAW)
    bodies = [Body(rod, LinearElastic(1.0, 0.3)), Body(sleeve, LinearElastic(2.0, 0.2))]
    supports = [Support.end(sleeve, "start", body=1), Support.end(rod, "end", displacement=(0.0, 0.05, 0.2))]
    assembler = assembler_for(Model(bodies, supports, ties=[tie]))
    rng = np.random.default_rng(3)
    x, way, force, other = (assembler.vector() for _ in range(4))
    x.array_w[:] = 0.05 * rng.standard_normal(x.local_size)
    way.array_w[:] = rng.standard_normal(x.local_size)
    bonds = assembler.coupling.bonds
    (bond,) = bonds._bonds
    sizes = np.linalg.norm(bond.slips(assembler.system_displacement(x, 0.7)), axis=1)
    assert sizes.min() < 0.1 and sizes.max() > 0.4
    small = 1e-7
    matrix = assembler.matrix()
    assembler.tangent(x, 0.7, matrix)
    assert (matrix * way).dot(x) == pytest.approx((matrix * x).dot(way), rel=1e-9)
    values = []
    for sign in (1.0, -1.0):
        moved = x + sign * small * way
        assembler.residual(moved, 0.7, force if sign > 0 else other)
        values.append(assembler.energy(moved, 0.7))
    difference = (force - other) * (0.5 / small)
    assert (difference - matrix * way).norm() < 1e-6 * difference.norm()
    assembler.residual(x, 0.7, force)
    assert (values[0] - values[1]) * 0.5 / small == pytest.approx(force.dot(way), rel=1e-6)
    ends = []
    for factor in (0.7 + small, 0.7 - small):
        out = assembler.vector()
        assembler.residual(x, factor, out)
        ends.append(out)
    out = assembler.vector()
    assembler.load_forces(x, 0.7, 1.0, out)
    assert ((ends[0] - ends[1]) * (0.5 / small) - out).norm() < 1e-6 * out.norm()


@pytest.mark.parametrize("slip", [pytest.param(0.05, marks=pytest.mark.slow), 0.2, 0.6])
def test_a_stiff_rod_is_pulled_out_by_perimeter_times_length_times_traction(slip):
    """Along and round it: 2 pi r L tau, and r times that as a torque."""
    bodies, held, tie = in_hole(2.0, RIGID, elements=2)
    end = bodies[0].space
    pulled = statics.solve(Model(bodies, [*held, Support.end(end, "end", "xyz", (0.0, 0.0, slip))], ties=[tie]), 4)
    force = 2.0 * np.pi * 0.5 * 2.0 * traction(slip)
    assert pulled.reactions[1] == pytest.approx([0.0, 0.0, force], rel=1e-5, abs=1e-5 * force)
    assert pulled.ties[0].force[2] == pytest.approx(-force, rel=1e-5)
    assert pulled.ties[0].slip == pytest.approx(slip, rel=1e-5)
    assert pulled.ties[0].traction[:, 2] == pytest.approx(-traction(slip), rel=1e-4)
    angle = 1e-2 * slip
    soft = [(1e-2 * s, t) for s, t in LAW]
    bodies, held, tie = in_hole(2.0, RIGID, soft, elements=2)
    turned = Support.end(end, "end", "xyz", turn=(0.0, 0.0, 2.0 * angle))
    assert statics.solve(Model(bodies, [*held, turned], ties=[tie]), 4).moments[1, 2] == pytest.approx(
        0.5 * force, rel=2e-3
    )


@pytest.mark.parametrize("end", [0.25, *(pytest.param(end, marks=pytest.mark.slow) for end in (0.12, 0.4))])
def test_a_bar_pulled_out_of_its_bond_is_that_of_shear_lag(end):
    """``E A u'' = 2 pi r tau(u)``, ``u'(0) = 0``, ``u(L) = end``; stiff in shear and without Poisson's effect."""
    length, radius, young = 6.0, 0.1, 100.0
    material = TransverselyIsotropic(young, 1e5, 0.0, 0.0, 1e5)
    bodies, held, tie = in_hole(length, material, radius=radius, elements=16, degree=3)
    space = bodies[0].space
    pulled = Support.end(space, "end", "xyz", (0.0, 0.0, end))
    found = statics.solve(Model(bodies, [*held, pulled], ties=[tie]), 10)

    def slope(z, y):
        return np.stack([y[1], 2.0 / (young * radius) * traction(y[0])])

    z = np.linspace(0.0, length, 401)
    start = np.stack([end * (z / length) ** 4, 4.0 * end * z**3 / length**4])
    exact = solve_bvp(slope, lambda a, b: np.array([a[1], b[0] - end]), z, start, tol=1e-8, max_nodes=100_000)
    assert exact.success
    force = young * np.pi * radius**2 * exact.sol(length)[1]
    # The law's kinks are within elements.
    assert found.reactions[1, 2] == pytest.approx(force, rel=2e-3)
    places = np.linspace(0.1, 0.95, 8)
    moved = [found.at(0, u)[2] for u in places]
    assert moved == pytest.approx(exact.sol(length * places)[0], abs=1e-3 * end)


def test_frequencies_about_a_slip_are_those_of_tangent_and_secant():
    """A disk on its bond: along the slip the tangent is its spring, across it the secant, in torsion half of both."""
    law, slip, density = [(0.0, 0.0), (0.1, 2.0), (0.3, 3.0)], 0.2, 2.0
    bodies, held, tie = on_floor(law, NeoHookean(1e6, 0.0), density=density)
    pull = SectionLoad.end(bodies[1].space, "start", (2.5 * np.pi, 0.0, 0.0), body=1)
    model = Model(bodies, held, loads=[pull], ties=[tie])
    secant, tangent = 2.5 / slip, 5.0
    found = modal.solve(model, 3, load_steps=2).frequencies
    exact = np.sqrt(np.sort([tangent, secant, 0.5 * (secant + tangent)]) / (density * 0.5))
    assert 2.0 * np.pi * found == pytest.approx(exact, rel=2e-3)
    rest = modal.solve(Model(bodies, held, ties=[tie]), 3).frequencies
    assert rest == pytest.approx(found[0] * np.sqrt(20.0 / tangent), rel=2e-3)


def pulled_out():
    bodies, held, tie = in_hole(2.0, NeoHookean(50.0, 0.3), elements=2)
    pulled = Support.end(bodies[0].space, "end", "xyz", (0.0, 0.05, 0.25))
    found = statics.solve(Model(bodies, [*held, pulled], ties=[tie]), 4)
    return [float(one) for one in (*found.reactions[1], found.ties[0].slip)]


def same(expected):
    assert pulled_out() == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.mpi
def test_ranks_agree(on_ranks):
    on_ranks(2, f"test_tie_bond.same({pulled_out()!r})")


@pytest.mark.parametrize("of_rods", [True, False])
def test_the_tangent_of_a_rod_bonded_to_a_finite_element_body(of_rods):
    """With the rod's end as slave, and with facets."""
    pytest.importorskip("dolfinx")
    import solids

    block = solids.solid(degree=1, place=lambda points: points - [0.5, 0.5, 1.0], law=LinearElastic(2.0, 0.3))
    top = solids.where(block.space.mesh, lambda x: np.isclose(x[2], 0.0))
    sides = EndFace(0, "start"), SolidSurface(0, top)
    model = Model(
        [Body(bar(1.0, radius=0.4 if of_rods else 0.8, elements=1), LinearElastic(1.0, 0.3))],
        solids=[block],
        ties=[Tie(*(sides if of_rods else sides[::-1]), kind="slide", bond=LAW)],
    )
    assembler = assembler_for(model)
    rng = np.random.default_rng(4)
    x, way, *forces = (assembler.vector() for _ in range(4))
    x.array_w[:] = 0.1 * rng.standard_normal(x.local_size)
    way.array_w[:] = rng.standard_normal(x.local_size)
    matrix = assembler.matrix()
    assembler.tangent(x, 1.0, matrix)
    for sign, force in zip((1.0, -1.0), forces, strict=True):
        assembler.residual(x + sign * 1e-7 * way, 1.0, force)
    difference = (forces[0] - forces[1]) * (0.5 / 1e-7)
    assert (difference - matrix * way).norm() < 1e-6 * difference.norm()


def test_a_load_above_the_peak_has_no_equilibrium():
    bodies, held, tie = on_floor([(0.0, 0.0), (0.1, 2.0), (0.3, 0.0)])
    pull = SectionLoad.end(bodies[1].space, "start", (2.2 * np.pi, 0.0, 0.0), body=1)
    with pytest.raises(SolveError) as caught:
        statics.solve(Model(bodies, held, loads=[pull], ties=[tie]), 4)
    assert "\n" not in str(caught.value)


def of(bond, kind="slide"):
    return lambda: Tie(EndFace(1, "start"), EndFace(0, "end"), kind=kind, bond=bond)


def in_motion():
    bodies, held, tie = on_floor(density=1.0)
    dynamics.solve(Model(bodies, held, ties=[tie]), 1.0, 0.5, integrator="implicit")


test_no_law_is_refused = refused(
    (of(-1.0), "tie: bond: got -1, need a stiffness, not negative"),
    (of(float("nan")), "tie: bond: got nan, need a stiffness, not negative"),
    (of([(0.0, 0.0)]), "tie: bond: got points of shape (1, 2), need two or more of (slip, traction)"),
    (of([(0.0, 0.1), (1.0, 1.0)]), "tie: bond: got (0, 0.1) first, need slips that ascend from (0, 0), and tract"),
    (of([(0.0, 0.0), (1.0, 0.0), (2.0, 1.0)]), "tie: bond: got (1, 0) as point 1, need slips that ascend from"),
    (of([(0.0, 0.0), (1.0, 1.0), (1.0, 0.5)]), "tie: bond: got (1, 0.5) as point 2, need slips that ascend"),
    (of([(0.0, 0.0), (1.0, 1.0), (2.0, -0.5)]), "tie: bond: got (2, -0.5) as point 2, need slips that"),
    (of([(0.0, 0.0), (1.0, float("inf"))]), "tie: bond: got points of which some are not finite, need slips"),
    (of(LAW, "weld"), "tie: got a bond of kind 'weld', need 'slide'"),
    (in_motion, "tie 0: bond: a law of traction over slip is for statics and modes; give a stiffness"),
)
