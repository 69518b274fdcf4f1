"""Reference values of contact against what they are derived from, their limits and invariances."""

import numpy as np
import pytest
from scipy.integrate import quad

from comparisons.contact import hertz, strand
from comparisons.contact.coil import Coil
from isorod.errors import InputError

MODULUS = hertz.modulus(1000.0, 0.3, 1000.0, 0.3)


def test_hertz_of_crossed_equal_cylinders():
    found = hertz.crossed_cylinders(1.0, MODULUS, (1.0, 1.0))
    assert found.long == pytest.approx(0.11093, abs=5e-6)
    assert found.short == pytest.approx(found.long, rel=1e-7)
    assert found.approach == pytest.approx(0.012305, abs=5e-7)
    assert found.peak == pytest.approx(38.80, abs=5e-3)
    # A sphere on a plane has the same gap.
    sphere = hertz.point_contact(1.0, MODULUS, hertz.gap((1.0, 1.0)))
    np.testing.assert_allclose(found, sphere, rtol=1e-7)


def test_hertz_in_other_units():
    """Lengths are scaled as the unit is; a rigid partner doubles the modulus of two equal ones."""
    metres = hertz.crossed_cylinders(5.0, MODULUS, (2.0, 0.5), 1.0)
    millimetres = hertz.crossed_cylinders(5.0, 1e-6 * MODULUS, (2e3, 0.5e3), 1.0)
    np.testing.assert_allclose(millimetres, metres * np.array([1e3, 1e3, 1e3, 1e-6]), rtol=1e-12)
    assert hertz.modulus(1000.0, 0.3) == pytest.approx(2.0 * MODULUS, rel=1e-14)


def lowered(found, x, y):
    """Displacement of both surfaces together where the pressure of an ellipse acts: ``1/(pi E*)`` times that of p/r."""

    def chord(angle):
        # Along a chord through the point the pressure is a half ellipse again.
        c, s = np.cos(angle), np.sin(angle)
        square = (c / found.long) ** 2 + (s / found.short) ** 2
        half = x * c / found.long**2 + y * s / found.short**2
        return 0.5 * np.pi * (1.0 - (x / found.long) ** 2 - (y / found.short) ** 2 + half**2 / square) / np.sqrt(square)

    return found.peak / (np.pi * MODULUS) * quad(chord, 0.0, np.pi, epsabs=0.0, epsrel=1e-11)[0]


@pytest.mark.parametrize(
    "radii, degrees", [((1.0, 1.0), 90.0), ((1.0, 3.0), 90.0), ((2.0, 1.0), 30.0), ((1.0, 1.0), 5.0)]
)
def test_hertz_pressure_closes_the_gap(radii, degrees):
    """The pressure's displacement, by quadrature, is the approach less the gap at every point of the ellipse."""
    gap = hertz.gap((1.0 / radii[0], 0.0), (1.0 / radii[1], 0.0), np.radians(degrees))
    found = hertz.crossed_cylinders(2.0, MODULUS, radii, np.radians(degrees))
    assert found.peak * 2.0 / 3.0 * np.pi * found.long * found.short == pytest.approx(2.0, rel=1e-12)
    for x, y in ((0.0, 0.0), (0.7, 0.0), (0.0, 0.6), (0.4, -0.5)):
        x, y = x * found.long, y * found.short
        expected = found.approach - gap.flat * x**2 - gap.steep * y**2
        assert lowered(found, x, y) == pytest.approx(expected, rel=1e-9)


def test_hertz_gap_is_the_distance_of_the_surfaces():
    """Of two cylinders at an angle, by the eigenvalues of the difference of their curvature tensors."""
    angle = np.radians(35.0)
    one, other = np.array([0.0, 1.0]), np.array([-np.sin(angle), np.cos(angle)])
    tensor = 0.5 * (np.outer(one, one) / 1.5 + np.outer(other, other) / 0.4)
    found = hertz.gap((1.0 / 1.5, 0.0), (1.0 / 0.4, 0.0), angle)
    np.testing.assert_allclose(found, np.linalg.eigvalsh(tensor), rtol=1e-12)
    with pytest.raises(InputError, match="the surfaces cross"):
        hertz.gap((1.0, 1.0), (-2.0, 0.0))


def test_hertz_ellipse_becomes_the_line():
    """Where cylinders almost are parallel, short axis and peak are those of the middle's force per length, 3F/(4a)."""
    with pytest.raises(InputError, match="along a line"):
        hertz.crossed_cylinders(1.0, MODULUS, (1.0, 2.0), 0.0)
    found = hertz.crossed_cylinders(1.0, MODULUS, (1.0, 2.0), 1e-4)
    line = hertz.line_contact(0.75 / found.long, MODULUS, (1.0, 2.0))
    # Beside the line stand logarithms of the ellipse's slenderness.
    assert found.short / found.long < 1e-3
    assert found.short == pytest.approx(line.half_width, rel=1e-5)
    assert found.peak == pytest.approx(line.peak, rel=1e-5)


def test_hertz_of_a_strand_wire_on_its_core():
    """The line load of 1 + 6 wires at a strain of 0.002: half width 0.022 mm, peak about 1.2 GPa."""
    line = hertz.line_contact(42.0, hertz.modulus(188e3, 0.3, 188e3, 0.3), (1.97, 1.865))
    assert line.half_width == pytest.approx(0.022, abs=5e-4)
    assert line.peak == pytest.approx(1.2e3, rel=0.03)


COIL = Coil(radius=10.0, wire=2.0, turns=5.0, lead=np.radians(10.0), E=210e3, nu=0.3)


def test_coil_force_and_touch():
    assert COIL.force(20.0) == pytest.approx(78.754, abs=5e-4)
    assert COIL.force(40.0) == pytest.approx(155.37, abs=5e-3)
    assert COIL.touch() == pytest.approx(45.39, abs=5e-3)
    assert COIL.force(COIL.touch()) == pytest.approx(175.8, abs=0.05)
    assert COIL.linear_force(COIL.touch()) / COIL.force(COIL.touch()) == pytest.approx(1.04, abs=5e-3)


def wrench(coil, shortening):
    """Force along the axis that holds the helix, from the moment of the wire in the frame of its curve."""

    def strains(shortening):
        radius, lead = coil.radius_at(shortening), coil.lead_at(shortening)
        turn, rise = np.cos(lead) / radius, np.sin(lead)
        # r', r'', r''' of a helix by its arc length, at the point (radius, 0, 0)
        r = np.array([[0.0, radius * turn, rise], [-radius * turn**2, 0.0, 0.0], [0.0, -radius * turn**3, 0.0]])
        binormal = np.cross(r[0], r[1])
        curvature = np.linalg.norm(binormal)
        return curvature, binormal @ r[2] / curvature**2, r[0], binormal / curvature, radius

    (k0, t0, *_), (k, t, tangent, binormal, radius) = strains(0.0), strains(shortening)
    moment = coil.bending * (k - k0) * binormal + coil.torsion * (t - t0) * tangent
    # A force (0, 0, F) and a couple (0, 0, K) on the axis have the moment (0, R F, K) at the point (R, 0, 0).
    assert abs(moment[0]) < 1e-12 * np.linalg.norm(moment)
    return moment[1] / radius


@pytest.mark.parametrize("lead", [3.0, 10.0, 35.0])
def test_coil_is_in_balance_with_a_wrench_on_its_axis(lead):
    coil = Coil(4.0, 0.5, 3.0, np.radians(lead), 100.0, 0.45)
    for shortening in (-0.3 * coil.height, 1e-3 * coil.height, 0.6 * coil.height):
        assert -wrench(coil, shortening) == pytest.approx(coil.force(shortening), rel=1e-8)
        step = 1e-4 * coil.height
        slope = (coil.energy(shortening + step) - coil.energy(shortening - step)) / (2.0 * step)
        assert coil.force(shortening) == pytest.approx(slope, rel=1e-5)


def test_coil_of_small_lead_and_shortening_is_the_linear_spring():
    """Errors of the formula are of the order of the lead's square, and twice as flat coils have a quarter of them."""
    errors = []
    for lead in (0.04, 0.02, 0.01):
        coil = Coil(10.0, 0.05, 5.0, lead, 210e3, 0.3)
        errors.append(coil.force(1e-4 * coil.height) / coil.linear_force(1e-4 * coil.height) - 1.0)
    assert abs(errors[-1]) < 1e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.05)


def test_turns_on_each_other_slide_off_from_the_force_that_bends_one_by_as_much():
    """Castigliano's theorem for a turn between ends that do not turn, by quadrature."""
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    moment = np.sin(angle) * COIL.radius
    shift = np.mean(moment**2) * 2.0 * np.pi * COIL.radius / COIL.bending
    assert np.mean(moment) == pytest.approx(0.0, abs=1e-12)
    assert COIL.sideways() == pytest.approx(COIL.wire / shift, rel=1e-12)
    # Not much more than what the spring takes to touch.
    assert 0.5 < COIL.sideways() / COIL.force(COIL.touch()) < 0.7


def test_flattened_coils_are_as_stiff_as_cylinders_between_lines():
    """Per unit length 1 / (pi E') (2 ln(4 r / b) - 2) a side: b^2 is in proportion to the load."""
    force, step = 20e3, 1.0
    slope = (COIL.flattened(force + step) - COIL.flattened(force - step)) / (2.0 * step)
    line = force / (2.0 * np.pi * COIL.radius_at(COIL.touch()))
    plane = COIL.E / (1.0 - COIL.nu**2)
    b = np.sqrt(4.0 * line / (np.pi * plane))
    sides = 8.0 * (np.log(16.0 / b**2) - 2.0) + 2.0 * (np.log(32.0 / b**2) - 2.0)
    assert slope * 2.0 * np.pi * COIL.radius_at(COIL.touch()) == pytest.approx(sides / (np.pi * plane), rel=1e-6)
    assert COIL.flattened(force) < 0.01 * COIL.turns * COIL.wire


def test_coils_touch_where_their_tubes_do():
    """Of flat coils the pitch is the wire, less what the slope of the wire takes: d/cos(lead)."""
    shortening = COIL.touch()
    lead = COIL.lead_at(shortening)
    pitch = 2.0 * np.pi * COIL.radius_at(shortening) * np.tan(lead)
    assert pitch * np.cos(lead) == pytest.approx(COIL.wire, rel=1e-5)
    assert COIL.clearance(shortening - 1.0) > 0.0 > COIL.clearance(shortening + 1.0)
    with pytest.raises(InputError, match="touch at rest"):
        Coil(10.0, 12.0, 5.0, np.radians(10.0), 1.0, 0.3).touch()


STEEL = 188e9, 0.3
WIRE = strand.Wire(0.5 * 3.73e-3, *STEEL)
SEVEN = strand.Strand(strand.Wire(0.5 * 3.94e-3, *STEEL), (strand.Layer(6, WIRE, 0.115),))


def layered(second=-0.21):
    """1 + 6 + 12 wires of several materials."""
    layers = (
        strand.Layer(6, strand.Wire(1.8e-3, 188e9, 0.3), 0.115),
        strand.Layer(12, strand.Wire(1.7e-3, 70e9, 0.3), second),
    )
    return strand.Strand(strand.Wire(2e-3, 100e9, 0.3), layers)


def test_strand_of_1_and_6_wires():
    matrix = SEVEN.stiffness()
    np.testing.assert_allclose(matrix[0], [1.3556e7, 9.075e3], rtol=5e-5)
    assert matrix[1, 1] == pytest.approx(17.860, abs=5e-4)
    assert SEVEN.helix_radii[0] == pytest.approx(3.835e-3)
    assert np.degrees(SEVEN.lay_angles[0]) == pytest.approx(11.834, abs=5e-4)


def energy(rope, strain, turn):
    """Of the strand per length, from the helices as they are: radii found by iteration, nothing linearised."""
    found = rope.core.stiffness @ [strain**2, 0.0, turn**2]
    surface = rope.core.radius * (1.0 - rope.core.nu * strain)
    for layer, rest in zip(rope.layers, rope.helix_radii, strict=True):
        at_rest, wire, radius = 2.0 * np.pi / layer.pitch, layer.wire, rest
        length = np.hypot(1.0, rest * at_rest)
        for _ in range(30):
            stretched = np.hypot(1.0 + strain, radius * (at_rest + turn))
            half = wire.radius * (1.0 - wire.nu * (stretched / length - 1.0))
            radius = surface + half
        around = at_rest + turn
        strains = np.array([stretched, radius * around**2 / stretched, (1.0 + strain) * around / stretched]) / length
        strains -= np.array([length, rest * at_rest**2 / length, at_rest / length]) / length
        found += layer.wires * length * wire.stiffness @ strains**2
        surface = radius + half
    return 0.5 * found


@pytest.mark.parametrize("rope", [SEVEN, layered(), layered(second=0.4)])
def test_strand_stiffness_is_the_curvature_of_its_energy(rope):
    e, t = 1e-5, 1e-5 / rope.helix_radii[-1]
    corner = [energy(rope, a * e, b * t) for a, b in ((1, 1), (-1, -1), (1, -1), (-1, 1))]
    axial = (energy(rope, e, 0.0) + energy(rope, -e, 0.0)) / e**2
    torsional = (energy(rope, 0.0, t) + energy(rope, 0.0, -t)) / t**2
    coupling = (corner[0] + corner[1] - corner[2] - corner[3]) / (4.0 * e * t)
    matrix = rope.stiffness()
    assert matrix[0, 1] == pytest.approx(matrix[1, 0], rel=1e-14)
    np.testing.assert_allclose([axial, torsional, coupling], [matrix[0, 0], matrix[1, 1], matrix[0, 1]], rtol=1e-6)


def test_strand_of_straight_wires_is_its_wires():
    matrix = strand.Strand(SEVEN.core, (strand.Layer(6, WIRE, 1e6),)).stiffness()
    alone = SEVEN.core.stiffness + 6.0 * WIRE.stiffness
    np.testing.assert_allclose([matrix[0, 0], matrix[1, 1]], [alone[0], alone[2]], rtol=1e-9)
    assert alone[0] == pytest.approx(1.4618e7, rel=5e-5)
    # What is left of the coupling is first in the lay angle: m EA r^2 2 pi/p.
    expected = 6.0 * WIRE.stiffness[0] * SEVEN.helix_radii[0] ** 2 * 2e-6 * np.pi
    assert matrix[0, 1] == pytest.approx(expected, rel=1e-9)


def test_strand_mirrored_and_enlarged():
    mirrored = strand.Strand(SEVEN.core, (strand.Layer(6, WIRE, -0.115),))
    np.testing.assert_allclose(mirrored.stiffness(), SEVEN.stiffness() * [[1.0, -1.0], [-1.0, 1.0]], rtol=1e-14)
    large = strand.Strand(
        SEVEN.core._replace(radius=3.0 * SEVEN.core.radius),
        (strand.Layer(6, WIRE._replace(radius=3.0 * WIRE.radius), 3.0 * 0.115),),
    )
    np.testing.assert_allclose(large.stiffness(), SEVEN.stiffness() * [[9.0, 27.0], [27.0, 81.0]], rtol=1e-12)
    # An outer layer of nothing changes nothing.
    airy = strand.Strand(SEVEN.core, (*SEVEN.layers, strand.Layer(12, WIRE._replace(E=1.0), -0.2)))
    np.testing.assert_allclose(airy.stiffness(), SEVEN.stiffness(), rtol=1e-9)
