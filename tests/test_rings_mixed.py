"""The mixed formulation of tubes and layered rods: stable pairs, exact solutions up to incompressibility."""

from itertools import pairwise

import numpy as np
import pytest
from refused import refused
from scipy.integrate import quad
from test_mixed import inf_sup
from test_rings import LENGTH, RADII, A, B, bent, held, lame, prism, radial, tube, twisted

from isorod import Space, circle, modal, naca, statics
from isorod.checks.finer import Finer
from isorod.material import LinearElastic, NeoHookean
from isorod.model import Body, Model, Pressure, Support

# Strains of some 1e-8: small stresses are those of large strain.
E = 2e8
LAYERS = (0.0, 0.4, 0.75, 1.0)


def layered(laws, section_degree=3, rings=LAYERS, **keywords):
    space = Space(prism(rings), **{"degree": 3, "section_degree": section_degree, "quadrature": "full"} | keywords)
    return space, Body(space, laws, formulation="mixed")


# The pair of spaces

ROUND = {
    "hole": ((0.5, 1.0), 0.12),
    "thin wall": ((0.9, 1.0), 0.025),
    "sheathed": ((0.0, 0.6, 1.0), 0.045),
    "tube of two layers": ((0.4, 0.7, 1.0), 0.035),
}


@pytest.mark.parametrize(("rings", "bound"), ROUND.values(), ids=ROUND)
def test_inf_sup_constant_is_bounded_below_when_the_axis_is_refined(rings, bound):
    """The thinner walls are beside elements' lengths, the smaller: of solid rods, a diameter an element, it is 0.27."""
    found = []
    for elements in (2, 4, 8):
        rod = prism(rings, circle(8, 1.0), length=4.0)
        found.append(inf_sup(Space(rod, elements=elements, degree=2, continuity=1, section_degree=4)))
    print(rings, *(f"{beta:.3f}" for beta in found))
    assert bound < found[0] < found[1] < found[2]


@pytest.mark.parametrize(("rings", "bound"), [((0.6, 1.0), 0.045), ((0.0, 0.6, 1.0), 0.015)])
def test_no_pressure_goes_unseen_in_an_airfoil(rings, bound):
    rod = prism(rings, 2.0 * naca("2412"), length=4.0)
    assert bound < inf_sup(Space(rod, elements=2, degree=3, continuity=1, section_degree=4))


@pytest.mark.parametrize("rings", [(0.3, 1.0), (0.9, 1.0), (0.0, 0.6, 1.0), (0.3, 0.6, 1.0)])
def test_a_round_section_has_all_pressures_of_one_degree_less_but_one_a_ring_round_a_hole(rings):
    """``N^2`` of them, or ``N (N + 1) / 2`` of a core, less ``r^-2``, which is the divergence of nothing."""
    for degree in (2, 3, 4):
        basis = Space(prism(rings), section_degree=degree, elements=1).basis
        core = rings[0] == 0.0
        # In a core's sheath both rings see what is not the divergence of displacements that meet: one together.
        assert basis.pressure_count == (len(rings) - 1 - core) * (degree**2 - 1) + core * degree * (degree + 1) // 2


@pytest.mark.parametrize("rings", [(0.4, 1.0), (0.0, 0.6, 1.0), (0.3, 0.6, 1.0)])
def test_each_ring_has_its_own_constant_among_the_pressures_and_finer_spaces_have_them_all(rings):
    space = Space(prism(rings), section_degree=3, elements=1)
    xi, _ = space.section_rule(space.basis.full(3))
    values = space.basis.pressures(xi)
    radius = np.hypot(*xi.T)
    for inner, outer in pairwise(rings):
        wanted = ((radius > inner) & (radius < outer)).astype(float)
        share = np.linalg.lstsq(values, wanted, rcond=None)[0]
        assert values @ share == pytest.approx(wanted, abs=1e-10)
    fine = Space(prism(rings), section_degree=4, elements=1).basis.pressures(xi)
    onto = np.linalg.lstsq(fine, values, rcond=None)[0]
    assert fine @ onto == pytest.approx(values, abs=1e-8 * np.abs(values).max())


# Exact solutions


@pytest.mark.parametrize("nu", [0.5, 0.49999, 0.4])
@pytest.mark.parametrize("section_degree", [2, 5])
def test_lame_tube_in_plane_strain(section_degree, nu):
    """``u_r = (1 + nu) / E ((1 - 2 nu) A r + B / r)`` and the mean stress ``2 (1 + nu) A / 3``."""
    space = tube(section_degree, degree=3)
    loads = [Pressure(2.0, "inner"), Pressure(0.7)]
    body = Body(space, LinearElastic(E, nu), formulation="mixed")
    model = Model([body], held(space, ("start", "end")), loads=loads)
    found, _, solution = radial(model, space, RADII)
    mean, other = lame(2.0, 0.7)
    assert found == pytest.approx((1 + nu) / E * ((1 - 2 * nu) * mean * RADII + other / RADII), rel=1e-8)
    assert solution.reactions[1, 2] == pytest.approx(2 * nu * mean * np.pi * (B**2 - A**2), rel=1e-7)
    stress = solution.stress(0, [0.5], np.outer(RADII / B, [1.0, 0.0]))[0]
    assert stress[:, 0, 0] == pytest.approx(mean - other / RADII**2, abs=1e-6)
    assert stress[:, 1, 1] == pytest.approx(mean + other / RADII**2, abs=1e-6)


@pytest.mark.slow
def test_inflated_rubber_tube():
    """Neo-Hookean, ``r^2 = R^2 + c``: the pressure is the integral of ``mu (r^2/R^2 - R^2/r^2) / r`` (Rivlin 1949).

    Here the inner radius grows by three tenths.
    """
    mu, grown = 1.0, 1.3 * A
    c = grown**2 - A**2

    def slope(R):
        r = np.sqrt(R**2 + c)
        return mu * (r**2 / R**2 - R**2 / r**2) * R / r**2

    pressure = quad(slope, A, B, epsabs=1e-13)[0]
    found = []
    for degree in (3, 5, 7):
        space = tube(degree, degree=3)
        body = Body(space, NeoHookean(3.0 * mu, 0.5))
        assert body.formulation == "mixed"
        load = Pressure(pressure, "inner", follows=True)
        model = Model([body], held(space, ("start", "end")), loads=[load])
        moved, _, solution = radial(model, space, RADII)
        found.append(np.abs(moved / (np.sqrt(RADII**2 + c) - RADII) - 1).max())
    assert found[0] < 0.02 and found[1] < 0.1 * found[0] and found[2] < 0.1 * found[1], found
    radial_stress = solution.stress(0, [0.5], np.outer(RADII / B, [1.0, 0.0]))[0, :, 0, 0]
    exact = [quad(slope, A, R, epsabs=1e-13)[0] - pressure for R in RADII]
    assert radial_stress == pytest.approx(exact, abs=1e-3 * pressure)


def composite(E, nu):
    """Return the axial stiffness of round layers, some incompressible: ``u = A r + B / r`` and ``p`` in each.

    The strain along the axis is 1; ``p = lame (2 A + 1)``, whatever ``lame`` is, as ``p / lame = 2 A + 1``.
    """
    edges, count = B * np.array(LAYERS), len(E)
    shear = np.array(E) / (2 * (1 + np.array(nu)))
    compliance = (1 - 2 * np.array(nu)) / (2 * shear * np.array(nu))
    rows, right = np.zeros((3 * count, 3 * count)), np.zeros(3 * count)
    rows[0, 1] = 1.0
    for j in range(count):
        r, k = edges[j + 1], 3 * j
        rows[k + 1, k : k + 3] = 2 * shear[j], -2 * shear[j] / r**2, 1.0
        rows[k + 2, k : k + 3] = 2.0, 0.0, -compliance[j]
        right[k + 2] = -1.0
        if j < count - 1:
            rows[k + 1, k + 3 : k + 6] = -2 * shear[j + 1], 2 * shear[j + 1] / r**2, -1.0
            rows[k + 3, k : k + 2] = r, 1 / r
            rows[k + 3, k + 3 : k + 5] = -r, -1 / r
    pressure = np.linalg.solve(rows, right)[2::3]
    return np.pi * np.diff(edges**2) @ (pressure + 2 * shear)


@pytest.mark.parametrize("nu", [(0.5, 0.3, 0.45), (0.2, 0.5, 0.4), (0.5, 0.5, 0.5), (0.45, 0.1, 0.3)])
def test_axial_stiffness_of_layers_some_of_which_are_incompressible(nu):
    moduli = (5.0, 200.0, 30.0)
    space, body = layered([LinearElastic(one, own) for one, own in zip(moduli, nu, strict=True)])
    pulled = [Support.end(space, "end", "z", (0.0, 0.0, 0.01)), *held(space, ("start",))]
    force = statics.solve(Model([body], pulled)).reactions[0, 2]
    assert force == pytest.approx(composite(moduli, nu) * 0.01 / LENGTH, rel=1e-7)


def test_pressure_jumps_between_layers_of_rubber_that_are_stretched_as_one():
    """Free outside, ``p = mu (1 - 1 / s)`` in each (`isorod.assembly.mixed`); the force is the sum of the layers'."""
    stretch, shear = 1.4, np.array([1.0, 7.0, 3.0])
    space, body = layered([NeoHookean(3.0 * one, 0.5) for one in shear])
    model = Model(
        [body], [Support.end(space, "end", "z", (0.0, 0.0, (stretch - 1.0) * LENGTH)), *held(space, ("start",))]
    )
    solution = statics.solve(model)
    area = np.pi * B**2 * np.diff(np.array(LAYERS) ** 2)
    assert solution.reactions[0, 2] == pytest.approx(area @ shear * (stretch - stretch**-2), rel=1e-8)
    middles = 0.5 * (np.array(LAYERS[1:]) + np.array(LAYERS[:-1]))
    found = body.pressures.evaluate(solution.pressures[0], np.outer(middles, [0.6, 0.8]), [0.3])[0]
    assert found == pytest.approx(shear * (1.0 - 1.0 / stretch), rel=1e-6)


def test_twisted_and_bent_layers():
    """Torsion changes no volume: the sum of the layers; bending of one ratio of Poisson the same."""
    moduli = (5.0, 200.0, 30.0)
    space, body = layered([LinearElastic(one, 0.5) for one in moduli])
    fourth = np.array(moduli) @ np.diff((B * np.array(LAYERS)) ** 4) * np.pi / 4
    moment = statics.solve(Model([body], twisted(space, 1e-5))).moments[1, 2]
    assert moment == pytest.approx(fourth * 2 / 3.0 * 1e-5 / LENGTH, rel=1e-7)
    moment = statics.solve(Model([body], bent(space, 0.01))).moments[0, 1]
    assert moment == pytest.approx(-fourth * 0.01, rel=1e-7)


def test_both_formulations_agree_where_nothing_locks():
    """A layered rod clamped at both ends, pushed aside."""
    space = Space(prism((0.3, 0.6, 1.0), length=5.0 * B), elements=4, degree=4, section_degree=5)
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(1.0, 0.0, 0.0))
    laws = [NeoHookean(3.0, 0.3), NeoHookean(20.0, 0.25)]
    forces = [
        statics.solve(Model([Body(space, laws, formulation=one)], ends)).reactions[1]
        for one in ("displacement", "mixed")
    ]
    assert forces[1] == pytest.approx(forces[0], rel=2e-3, abs=1e-3 * abs(forces[0]).max())


def test_modes_of_an_incompressible_tube_and_of_one_in_layers():
    """Torsional ones of a tube that is held at one face; rigid shear waves ``sqrt(mu / rho)`` in each layer."""
    for rings, shear in (((0.5, 1.0), [3.0]), ((0.0, 0.5, 1.0), [3.0, 12.0])):
        space = Space(prism(rings, length=8.0), elements=3, degree=5, section_degree=3)
        laws = [LinearElastic(3.0 * one, 0.5) for one in shear]
        body = Body(space, laws[0] if len(laws) == 1 else laws, list(shear) if len(laws) > 1 else shear[0])
        assert body.formulation == "mixed"
        model = Model([body], [Support.end(space, "start")])
        found = modal.solve(model, 12).frequencies
        for k in (1, 3):
            assert np.abs(found / (k / (4 * 8.0)) - 1).min() < 1e-5, found


# What is chosen, what is refused


def test_it_is_chosen_where_it_pays():
    space = Space(prism((0.0, 0.5, 1.0)), section_degree=3, elements=2)
    soft, hard, steel = NeoHookean(3.0, 0.4999), NeoHookean(3.0, 0.5), NeoHookean(100.0, 0.3)
    for laws, wanted in (
        ([soft, soft], "mixed"),
        ([hard, steel], "mixed"),
        ([soft, steel], "displacement"),
        ([steel, steel], "displacement"),
    ):
        assert Body(space, laws).formulation == wanted


def test_pressures_on_a_finer_space_are_those_of_the_coarse():
    space, body = layered([NeoHookean(3.0, 0.5), NeoHookean(9.0, 0.5)], rings=(0.0, 0.5, 1.0), elements=2)
    model = Model([body], [Support.end(space, "start"), Support.end(space, "end", displacement=(0.2, 0.0, 0.3))])
    solution = statics.solve(model)
    for direction in ("section", "axis"):
        finer = Finer.of(model, direction)
        (found,) = finer.pressures(solution.pressures)
        fine, xi, u = finer.model.bodies[0].pressures, np.array([[0.3, 0.1], [0.2, -0.8], [0.5, 0.0]]), [0.1, 0.6]
        wanted = body.pressures.evaluate(solution.pressures[0], xi, u)
        assert fine.evaluate(found, xi, u) == pytest.approx(wanted, abs=1e-7 * np.abs(wanted).max())


RUBBER = LinearElastic(3.0, 0.5)

test_refusals = refused(
    (lambda: layered(RUBBER, section_degree=1)[1].pressures, "section degree: got 1, the mixed formulation needs at"),
    (
        lambda: layered([RUBBER, LinearElastic(3.0, 0.0), RUBBER])[1].pressures,
        "material of element 0: the mixed formulation needs a law",
    ),
)
