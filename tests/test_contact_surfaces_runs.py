"""Runs with contact of any section and of inner surfaces: exact solutions, finer spaces, Coulomb, energy, files."""

import warnings
from functools import cache

import numpy as np
import pytest
from conftest import straight
from surfaces import falling, fit_pressure, pin, press_fit, strip, tube
from touching import LAW, moved

from isorod import Body, Contact, Model, Space, dynamics, statics
from isorod.contact.tunnelling import Tunnelling


@pytest.mark.parametrize("hollow", [False, True])
def test_a_press_fit_has_lames_pressure_everywhere(hollow):
    """But for a part in a thousand: pressures are per reference area, of radii that differ by the interference."""
    result = statics.solve(press_fit(hollow)).contacts[0]
    assert result.pressure == pytest.approx(fit_pressure(hollow), rel=1e-3)
    assert result.doubt() is None


def test_a_tube_drawn_out_of_another_rubs_with_coulombs_force():
    """All points slip; what one loses the other gets, and the forces that draw are those of friction."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = statics.solve(press_fit(True, slide=0.5, friction=0.1), load_steps=4)
    result = found.contacts[0]
    assert result.sticking == 0 and result.slipping > 500
    assert result.friction == pytest.approx([0.0, 0.0, -0.1 * result.force], abs=1e-8 * result.force)
    # In the part that is still inside.
    assert result.force == pytest.approx(fit_pressure(True) * 2.0 * np.pi * 10.0 * 9.5, rel=0.06)
    drawn = found.reactions[3, 2]
    assert drawn == pytest.approx(-(result.friction + result.resultant)[2], rel=1e-6)
    assert found.reactions[0, 2] == pytest.approx(-drawn, rel=1e-6)


def test_a_press_fit_sticks_as_long_as_friction_can():
    result = statics.solve(press_fit(True, slide=1e-5, friction=0.3), load_steps=2).contacts[0]
    assert result.slipping == 0 and result.sticking > 500


@cache
def pinned(*degrees):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return statics.solve(pin(degrees), load_steps=2).contacts[0]


def test_a_pin_in_a_hole_presses_as_on_finer_spaces():
    coarse, fine = pinned(6, 8), pinned(8, 11)
    assert coarse.resultant == pytest.approx(fine.resultant, rel=5e-3, abs=2e-5)
    assert abs(coarse.peak / fine.peak - 1.0) < coarse.peak_error
    # The patch is round the bottom, on both surfaces, as wide on one as on the other.
    widths = []
    for result in (coarse, fine):
        for body in range(2):
            here = result.body == body
            load = (result.areas * result.pressure)[here]
            angle = np.degrees(result.parameters[here, 1]) % 360.0
            middle = load @ angle / load.sum()
            assert middle == pytest.approx(270.0, abs=0.5)
            widths.append(np.sqrt(load @ (angle - middle) ** 2 / load.sum()))
    assert widths == pytest.approx([widths[-1]] * 4, rel=0.05)


@pytest.mark.parametrize(("degree", "error"), [(6, 0.03), (8, 0.035)])
def test_a_cylinder_pressed_flat_by_planes_is_that_of_control_points_or_is_warned_of(degree, error):
    """128 control points round the section, 17 across the patch, press with 0.14099."""
    space = Space.paper(straight(8, degree=1), degree=1, section_degree=degree, quadrature="16x4x1")
    with pytest.warns(UserWarning, match="under-resolved: .* use a higher section degree"):
        found = statics.solve(strip(space, 0.3)).contacts
    assert [one.force for one in found] == pytest.approx([0.14099, 0.14099], rel=error)


def test_a_tube_between_planes_presses_as_on_finer_spaces_or_is_warned_of():
    """Section degree 12 presses with 0.01145."""
    space = tube(8, height=1.0, breaks=(0.0, 1.0))
    with pytest.warns(UserWarning, match="under-resolved"):
        found = statics.solve(strip(space, 0.2)).contacts
    assert [one.force for one in found] == pytest.approx([0.01145, 0.01145], rel=0.025)


@pytest.mark.parametrize(
    ("integrator", "step", "friction"), [("explicit", None, 0.0), ("explicit", None, 0.3), ("implicit", 0.005, 0.3)]
)
def test_a_hollow_rod_with_one_in_it_thrown_on_a_plane_keeps_the_balance(integrator, step, friction):
    """Of energy, and of momentum along the plane, where nothing rubs."""
    model, velocity = falling(friction=friction)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = dynamics.solve(model, 0.5, step, outputs=5, velocity=velocity, integrator=integrator)
    energy = np.asarray(run.kinetic) + run.stored + run.contact_energy + run.dissipated
    assert energy == pytest.approx(energy[0], rel=2e-3)
    assert run.contact_energy.max() > 0.01 * energy[0]
    assert bool(run.dissipated[-1] > 1e-3 * energy[0]) is bool(friction)
    assert run.velocity[-1].reshape(-1, 3)[model.is_control_point][:, 1].max() > 0.0
    assert np.abs(run.momentum_error).max() < (1e-10 if integrator == "explicit" else 1e-6)


def test_a_rod_that_would_come_out_through_the_wall_is_refused_and_one_in_the_hole_is_not():
    rod = moved(straight(8, breaks=(0.0, 1.0, 2.0), radius=0.3, height=2.0), (0.25, 0.0, 2.0))
    spaces = [tube(hole=0.6), Space.paper(rod)]
    model = Model([Body(space, LAW) for space in spaces], contacts=[Contact(1, 0, second_surface="inner")])
    watch, rest = Tunnelling(model), np.zeros(model.dofs)

    def at(shift):
        found = np.zeros((model.dofs // 3, 3))
        found[int(model.first_node[1]) :] = shift
        return found.ravel()

    # To the axis, past it, and out at the end.
    assert watch.passed(rest, at([-0.25, 0.0, 0.0])) is None
    assert watch.passed(rest, at([-0.5, 0.0, 0.0])) is None
    assert watch.passed(rest, at([0.0, 0.0, 9.0])) is None
    assert "tunnelling of body 1" in watch.passed(rest, at([1.5, 0.0, 0.0]))
    assert watch.passed(at([1.5, 0.0, 0.0]), at([2.5, 0.0, 0.0])) is None


FILE = """
[rod.tube]
curve = {straight = 4.0}
section = {circle = 1.0}
rings = [0.6, 1.0]
law = {LinearElastic = {E = 1000.0, nu = 0.3}}
space = {section_degree = 3, elements = 4, degree = 2}

[rod.wire]
curve = {straight = {start = [0.0, 0.0, -1.0], end = [0.0, 0.0, 5.0]}}
section = {circle = 0.5}
law = {LinearElastic = {E = 100.0, nu = 0.3}}
space = {section_degree = 4, elements = 6, degree = 2}

[support.tube]
rod = "tube"
end = "start"

[support.left]
rod = "wire"
end = "start"
displacement = [0.0, -0.15, 0.0]

[support.right]
rod = "wire"
end = "end"
displacement = [0.0, -0.15, 0.0]

[contact.inside]
first = "wire"
second = "tube"
second_surface = "inner"
friction = 0.2

[measure.force]
contact_force = "inside"

[analysis.statics]
load_steps = 2
"""


@pytest.mark.slow
def test_a_wire_in_a_tube_from_a_file(tmp_path, command):
    (tmp_path / "wire.toml").write_text(FILE)
    found = command.record("run", tmp_path / "wire.toml")
    points = "space = {order = 2, section_points = 24, elements = 6, degree = 2}"
    told = FILE.replace("space = {section_degree = 4, elements = 6, degree = 2}", points)
    (tmp_path / "points.toml").write_text(told)
    expected = command.record("run", tmp_path / "points.toml")
    # At the edge of the tube's mouth, of which both are warned.
    assert found["force"] == pytest.approx(expected["force"], rel=0.05)
    assert found["contacts"][0]["resultant"][1] == pytest.approx(found["force"], rel=0.01)
    bad = tmp_path / "bad.toml"
    bad.write_text(FILE.replace('second_surface = "inner"', 'first_surface = "inner"'))
    assert "rod wire has no hole, but its inner surface is named" in command.refuses("run", bad)
    bad.write_text(FILE.replace('second_surface = "inner"', 'second_surface = "inside"'))
    assert "need 'outer' or 'inner'" in command.refuses("run", bad)
