"""Pressure between core and wire of a strand: a piece that is fine along their line of contact."""

from dataclasses import replace

import numpy as np
import pytest

from comparisons.contact import wire
from isorod import statics
from isorod.contact.operator import ContactOperator


def test_gap_opens_across_the_line_of_contact_as_the_curvature_says():
    """Seen from the rods of the piece: the wire's surface is on the core's along a line, and leaves it aside."""
    core, winding = (body.space.rod for body in wire.segment(arcs=16).bodies)
    assert np.linalg.norm(core.grid([[1.0, 0.0]], [0.5])[0][0, 0, :2]) == pytest.approx(wire.SCENE.core_radius)
    aside = 0.01
    angles = np.pi + np.array([-aside, 0.0, aside])
    xi = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    u = np.linspace(0.2, 0.8, 5)
    gap = np.linalg.norm(winding.grid(xi, u)[0][:, :, :2], axis=2) - wire.SCENE.core_radius
    np.testing.assert_allclose(gap[:, 1], 0.0, atol=1e-6)
    # The line is not quite along the wire.
    across = wire.SCENE.wire_radius * aside * np.cos(wire.SCENE.lay_angle - wire.line_angle())
    np.testing.assert_allclose((gap[:, 0] + gap[:, 2]) / across**2, wire.curvature(), rtol=1e-3)


def test_arcs_are_short_at_the_line_alone():
    for body, angle in zip(wire.segment().bodies, (0.0, np.pi), strict=True):
        basis = body.space.basis
        lengths = np.diff(basis.joints)
        middles = np.angle(np.exp(1j * (0.5 * (basis.joints[1:] + basis.joints[:-1]) - angle)))
        radius = wire.SCENE.core_radius
        at = np.abs(middles) * radius < wire.exact(wire.LOAD).half_width
        assert 2.0 * wire.exact(wire.LOAD).half_width / (radius * lengths[at].max()) > 3.5
        assert lengths.size < 80


def test_pressure_of_hertz_is_measured_as_that():
    """Each side has half of the areas; which sections count as the middle does not matter where all have the same.

    Some eleven points see the patch.
    """
    model, exact = wire.segment(), wire.exact(wire.LOAD)
    (found,) = ContactOperator(model).results(np.zeros(model.dofs))
    radius = np.where(found.body == 0, wire.SCENE.core_radius, wire.SCENE.wire_radius)
    angle = np.angle(np.exp(1j * (found.parameters[:, 1] - np.pi * found.body)))
    aside = np.cos(wire.line_angle()) * radius * angle / exact.half_width
    line = wire.measure(replace(found, pressure=exact.peak * np.sqrt(np.maximum(0.0, 1.0 - aside**2))))
    assert line.load == pytest.approx(wire.LOAD, rel=0.01)
    assert line.half_width == pytest.approx(exact.half_width, rel=0.02)
    assert line.peak == pytest.approx(line.exact.peak, rel=0.01)


@pytest.mark.slow
def test_peak_pressure_between_core_and_wire_is_that_of_hertz():
    """At the line load of the strand pulled by 0.002: 42.2 per length of wire, which is longer than the line."""
    (found,) = statics.solve(wire.segment()).contacts
    line = wire.measure(found)
    scene = wire.SCENE
    assert line.load == pytest.approx(42.21 * np.cos(wire.line_angle()) / np.cos(scene.lay_angle), rel=0.05)
    assert line.peak == pytest.approx(line.exact.peak, rel=0.05)
    assert line.half_width == pytest.approx(line.exact.half_width, rel=0.03)
