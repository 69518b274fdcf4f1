"""Stiffness and mass per length of sections against solids, and the section functions they come from."""

from itertools import pairwise

import numpy as np
import pytest

import isorod
from isorod import Body, LinearElastic, Model, SectionLoad, Space, Support, statics
from isorod.geometry.quadrature import Rule, section_points
from isorod.geometry.section import airfoil, circle, ellipse, flower, rounded_rectangle
from isorod.output.prism import Prism
from isorod.output.section_properties import apart, section_properties
from isorod.output.state import State
from isorod.space.polynomial import polynomials
from isorod.space.waves import Waves
from isorod.tensors import determinant

E, NU = 210.0, 0.3
LAW = LinearElastic(E, NU)


def straight(outline, length=1.0):
    return isorod.straight(length).sweep(outline)


@pytest.mark.parametrize("rings", [[0, 1], [0.5, 1]])
def test_mass_is_that_of_the_rod(rings):
    """The polar part is the integral of what it stands for; along a straight bar mass times length is the volume's."""
    rod, density = straight(airfoil(), 3.0).with_rings(rings), 7.0
    found = section_properties(Body(Space(rod, section_degree=4), LAW, density))
    assert found.mass[0, 0] * 3.0 == pytest.approx(density * rod.volume(), rel=1e-9)
    assert found.mass[0, 0] == pytest.approx(density * found.area, rel=1e-12)
    assert found.mass[3, 3] == pytest.approx(found.mass[4, 4] + found.mass[5, 5], rel=1e-12)
    # Of one material bending stiffness and mass are alike.
    assert found.mass[4:, 4:] * E == pytest.approx(found.stiffness[4:, 4:] * density, rel=1e-3, abs=1e-4)
    moving = np.array([1.0, -2.0, 0.5, 0.7, 0.2, -0.4])
    assert moving @ found.mass @ moving > 0.0


def test_frame_and_centroid_are_those_of_section_forces():
    body = isorod.scenes.find("blade")(quadrature="full").model().bodies[0]
    at_rest = State(Model([body]), np.zeros(3 * body.space.nodes))
    forces, found = at_rest.section_forces(0, 0.3), section_properties(body, 0.3)
    assert found.centroid == pytest.approx(forces.centroid, abs=5e-6)
    assert found.frame == pytest.approx(forces.frame, abs=1e-6)


def test_a_tapered_blade_scales():
    body = isorod.scenes.find("blade")().model().bodies[0]
    root, tip = (section_properties(body, u) for u in ("start", "end"))
    sizes = np.array([0.5, 0.5, 0.5, 0.25, 0.25, 0.25])
    assert apart(tip.stiffness, root.stiffness * np.outer(sizes, sizes)) < 1e-6
    assert root.u == 0.0


def cantilever(outline, length, force, law=LAW, **space):
    """A clamped bar with a force on the whole of its end, solved."""
    rod = straight(outline, length)
    space = Space(rod, **{"degree": 5, "continuity": 0} | space)
    load = SectionLoad.end(space, "end", force)
    return rod, statics.solve(Model([Body(space, law)], [Support.end(space, "start")], loads=[load]))


@pytest.mark.parametrize(
    ("outline", "degree", "error"), [(circle(8, 0.5), 3, 1e-10), (ellipse(8, 0.5, 0.2), 6, 1e-6), (airfoil(), 8, 2e-4)]
)
def test_energy_of_a_solid_bar_away_from_its_ends(outline, degree, error):
    """What the solid stores per length is what the 6 x 6 stiffness says of the forces in its section."""
    rod, solution = cantilever(outline, 10.0, (3e-3, 2e-3, 1e-3), section_degree=degree, elements=20)
    found = section_properties(rod, 0.5, LAW)
    u = np.linspace(0.45, 0.55, 7)
    xi, area = section_points(rod.section_points, Rule(14, 10, 1))
    gradient = solution.deformation_gradient(0, u, xi)
    _, jacobian = rod.grid(xi, u)
    stored = np.einsum("q,tq,tq->t", area, determinant(jacobian) / 10.0, LAW.energy(gradient))
    forces = solution.section_forces(0, u)
    six = np.concatenate([forces.N[:, None], forces.Q, forces.M], axis=1)
    assert stored == pytest.approx(0.5 * np.einsum("ti,ij,tj->t", six, found.compliance, six), rel=error)
    # Shear has its share of that.
    without = 0.5 * np.einsum("ti,ij,tj->t", six[:, 3:], found.compliance[3:, 3:], six[:, 3:])
    assert (stored > 1.002 * without).all()


def test_tip_of_a_cantilever():
    """Timoshenko's beam against the solid: an airfoil that a force at its centroid bends, shears and twists.

    Without Poisson's effect, which a clamp hinders over a length like the section's.
    """
    length, force, law = 20.0, np.array([1e-5, 2e-5, 0.0]), LinearElastic(E, 0.0)
    rod, solution = cantilever(airfoil(), length, force, law, section_degree=8, elements=16)
    found = section_properties(rod, 0.0, law)
    local, tip = found.frame @ force, np.zeros(6)
    s, w = np.polynomial.legendre.leggauss(4)
    for share, weight in zip(0.5 * (s + 1), 0.5 * w, strict=True):
        arm = np.array([(1 - share) * length, 0.0, 0.0])
        # The work of unit forces and moments at the tip.
        units = np.eye(6)
        units[:3, 3:] = np.cross(arm, np.eye(3))
        tip += weight * length * units @ found.compliance @ np.concatenate([local, np.cross(arm, local)])
    xi, area = section_points(rod.section_points, Rule(14, 10, 1))
    place, jacobian = rod.grid(xi, [1.0])
    share = area * determinant(jacobian[0]) / (area @ determinant(jacobian[0]))
    moved = solution.at(rod, "end", xi) @ found.frame.T
    assert share @ moved == pytest.approx(tip[:3], rel=1e-4, abs=1e-6 * np.abs(tip).max())
    _, y, z = found.frame @ (place[0] - share @ place[0]).T
    turned = share @ (y * moved[:, 2] - z * moved[:, 1]) / (share @ (y**2 + z**2))
    assert turned == pytest.approx(tip[3], rel=2e-2)


def test_all_polynomial_solutions_of_a_prism_say_the_same():
    """Of any material, about any point: those of the differential equation along the prism, without beam theory.

    With displacements w of the section functions the balance of ``C^T w + M w'`` is ``E w + C w'``.  Its polynomial
    solutions are six rigid motions, and six that carry forces.
    """
    rng = np.random.default_rng(5)
    root = rng.normal(size=(6, 6))
    voigt = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
    moduli = (root @ root.T + np.eye(6))[voigt[:, :, None, None], voigt[None, None]]
    prism = Prism(airfoil() + np.array([0.3, 0.2]), (0.0, 1.0), moduli[None], np.ones(1))
    basis, size = polynomials(prism.rod, 4), prism._size
    M, C, E = prism._matrices(basis, 1.0)
    nothing, skew = np.zeros_like(M), C.T - C
    rows = [
        [-E, skew, M, nothing],
        [nothing, -E, skew, M],
        [nothing, nothing, -E, skew],
        [nothing, nothing, nothing, -E],
    ]
    _, values, directions = np.linalg.svd(np.block(rows))
    assert np.count_nonzero(values < 1e-9 * values[0]) == 12
    place, slope, *_ = directions[-12:].reshape(12, 4, -1).swapaxes(0, 1)
    energy = place @ E @ place.T + place @ C @ slope.T + slope @ C.T @ place.T + slope @ M @ slope.T
    forces = (place @ C + slope @ M) @ prism._rigid(basis)
    of_forces = np.linalg.pinv(forces)
    units = np.array([1.0, 1.0, 1.0, size, size, size])
    exact = np.linalg.inv(of_forces @ energy @ of_forces.T) * np.outer(units, units) * size**2
    assert apart(exact, prism.stiffness(basis)) < 1e-7


class Fibres(LinearElastic):
    """Stiffer along a direction in space."""

    def tangent(self, F):
        fibre = np.array([1.0, 2.0, 2.0]) / 3
        return super().tangent(F) + 5 * E * np.einsum("a,b,c,d->abcd", fibre, fibre, fibre, fibre)


def test_moduli_turn_with_the_rod():
    """Fibres along a rod stretch with it, across it they bend nothing; laws speak of space."""
    along, across = (isorod.straight(start=(0, 0, 0), end=end) for end in ((1, 2, 2), (2, 1, -2)))
    law = Fibres(E, 0.0)
    area = np.pi * 0.25
    stiff, soft = (section_properties(line.sweep(circle(8, 0.5)), material=law) for line in (along, across))
    assert stiff.EA == pytest.approx(6 * E * area, rel=1e-8)
    assert soft.EA == pytest.approx(E * area, rel=1e-8)


def test_finer_functions_are_softer_and_nearer():
    """Where nothing shears the energy is a least one: each degree adds to the compliance."""
    prism = Prism(airfoil(), (0.0, 1.0), LAW.tangent(np.eye(3)[None]), np.ones(1))
    found = [prism.stiffness(polynomials(prism.rod, degree)) for degree in (2, 4, 6, 8)]
    even = [np.linalg.inv(one)[np.ix_([0, 3, 4, 5], [0, 3, 4, 5])] for one in found]
    for coarse, fine in pairwise(even):
        assert np.linalg.eigvalsh(fine - coarse).min() > -1e-12 * np.abs(fine).max()
    errors = [apart(found[-1], one) for one in found[:-1]]
    assert errors[0] > 3 * errors[1] > 9 * errors[2]


@pytest.mark.parametrize("outline", [flower(), rounded_rectangle(16, 1.0, 0.7, 0.1)])
def test_estimates_hold_against_other_functions(outline):
    found = section_properties(straight(outline), material=LAW)
    moduli = LAW.tangent(np.eye(3)[None])
    # As of two layers, with a kink between them where there is none.
    prism = Prism(outline, (0.0, 0.4, 1.0), np.concatenate([moduli, moduli]), np.ones(2))
    other = prism.stiffness(Waves(prism.rod, 32, 7))
    assert apart(other, found.about((0, 0)).stiffness) < found.error + 2e-3 < 5e-3


def test_waves_are_what_their_slopes_say():
    """In a hollow section of two layers; coordinates are among them, and all are continuous."""
    outline, rings = airfoil(), (0.4, 0.7, 1.0)
    waves = Waves(straight(outline).with_rings(rings), 5, 4)
    rng = np.random.default_rng(3)
    radius, angle, h = rng.uniform(0.45, 0.95, 50), rng.uniform(0, 7, 50), 1e-6
    xi = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    xi = xi[np.abs(radius - 0.7) > 1e-3]
    _, slopes = waves.functions(xi)
    for k, step in enumerate(h * np.eye(2)):
        rise = (waves.functions(xi + step)[0] - waves.functions(xi - step)[0]) / (2 * h)
        assert np.abs(rise - slopes[:, :, k]).max() < 1e-6 * np.abs(slopes).max()
    polygon = np.concatenate([np.zeros((16, 1)), outline], axis=1)
    place = waves.functions(xi)[0] @ waves.positions(polygon[None])[0]
    assert place[:, 1:] == pytest.approx(straight(outline).points(xi, np.zeros(len(xi)))[:, :2], abs=1e-12)
    inside, outside = (waves.functions([[r, 0.0]])[0] for r in (0.7 - 1e-9, 0.7 + 1e-9))
    assert np.abs(inside - outside).max() < 1e-6
