"""Springs and hooks of one line each, run as files are: against thin wires' energy and curved beams."""

import numpy as np
import pytest

from isorod import statics
from isorod.files.scene import FileScene
from isorod.geometry.fitting import evaluate

E, G = 2.0e5, 2.0e5 / 2.6
HEAD = """
law = {LinearElastic = {E = 2.0e5, nu = 0.3}}
[support.foot]
end = "start"
"""
PULLED = """
[load.tip]
end = "end"
force = [0.0, 0.0, 0.01]
[analysis.statics]
[measure.answer]
displacement = "wire"
component = "z"
"""
EXTENSION = (
    "curve = {direction = [1, 0, 0], normal = [0, 0, 1], chain = [{arc = {radius = 5, angle = 90}},"
    "{arc = {radius = 1.5, angle = 90, roll = -90}}, {helix = {radius = 5, pitch = 1.2, turns = 6.5, roll = 90}},"
    "{arc = {radius = 1.5, angle = 90, roll = 90}}, {arc = {radius = 5, angle = 90, roll = -90}}]}"
)
TORSION = (
    "curve = {direction = [1, 0, 0], normal = [0, 1, 0], chain = ["
    "{straight = 20}, {helix = {radius = 8, pitch = 1.3, turns = 5.25}}, {straight = 20}]}"
)
BAR = (
    "curve = {direction = [0, 1, 0], normal = [-1, 0, 0], chain = [{straight = 250},"
    "{arc = {radius = 50, angle = 70}}, {straight = 700}, {arc = {radius = 50, angle = 70}}, {straight = 250}]}"
)
S_HOOK = (
    "curve = {direction = [1, 0, 0], normal = [0, 0, 1], chain = ["
    "{arc = {radius = 10, angle = 180}}, {arc = {radius = 10, angle = -180}}]}"
)
CONE = "curve = {helix = {radius = [10.0, 6.0], pitch = 2.0, turns = 12}}"
CLOCK = "curve = {helix = {radius = [5.0, 15.0], pitch = 0.0, turns = 6}}"


def scene(tmp_path, *parts):
    path = tmp_path / "scene.toml"
    path.write_text("\n".join(["[rod.wire]", *parts]))
    return FileScene(str(path))


def answer(of):
    return of.measure(statics.solve(of.model()))["answer"]


def flexibility(line, radius):
    """Return displacement and rotation of the end per force and moment there, ``(6, 6)``, of a thin wire held at first.

    Castigliano's integrals, with the shear coefficient of circles (Cowper, J. Appl. Mech. 33, 1966).
    """
    gauss, weights = np.polynomial.legendre.leggauss(8)
    u = line.axis.within(0.5 * (gauss + 1.0)).ravel()
    places, slopes = evaluate(line.axis, line.centers, u)
    speed = np.linalg.norm(slopes, axis=1)
    step = (0.5 * np.diff(line.axis.breaks)[:, None] * weights).ravel() * speed
    arm = line.centers[-1] - places
    tangent = slopes / speed[:, None]
    area, bending, shear = np.pi * radius**2, 0.25 * np.pi * radius**4, (6 + 12 * 0.3 + 6 * 0.09) / (7 + 3.6 + 0.36)
    along = np.einsum("ta,tb->tab", tangent, tangent)
    across = np.eye(3) - along
    lever = np.zeros((u.size, 6, 6))
    lever[:, :3, :3] = lever[:, 3:, 3:] = np.eye(3)
    lever[:, 3:, :3] = np.cross(arm[:, None, :], np.eye(3)).swapaxes(1, 2)
    give = np.zeros((u.size, 6, 6))
    give[:, :3, :3] = along / (E * area) + across / (shear * G * area)
    give[:, 3:, 3:] = along / (2.0 * G * bending) + across / (E * bending)
    return np.einsum("t,tki,tkl,tlj->ij", step, lever, give, lever)


def line_of(of):
    return of.plans["wire"].curve.make()


@pytest.mark.parametrize("curve, radius, within", [(EXTENSION, 0.25, 3e-3), (BAR, 11.0, 2e-3)])
def test_hooked_springs_and_stabiliser_bars_give_as_thin_wires_do(tmp_path, curve, radius, within):
    of = scene(tmp_path, curve, f"section = {{circle = {radius}}}", HEAD, PULLED)
    assert answer(of) == pytest.approx(0.01 * flexibility(line_of(of), radius)[2, 2], rel=within)


def test_a_conical_spring_has_the_rate_of_the_handbooks(tmp_path):
    """``G d^4 / (16 n (R1 + R2) (R1^2 + R2^2))``: torsion alone (Wahl, Mechanical Springs)."""
    moved = '[support.tip]\nend = "end"\ndisplacement = [0, 0, 0.01]\n[analysis.statics]\n[measure.answer]\n'
    of = scene(tmp_path, CONE, "section = {circle = 0.3}", HEAD, moved + 'stiffness = "tip"')
    found = answer(of)
    assert found == pytest.approx(G * 0.6**4 / (16 * 12 * 16 * 136), rel=4e-3)
    assert found == pytest.approx(np.linalg.inv(flexibility(line_of(of), 0.3))[2, 2], rel=2e-3)


def test_a_torsion_spring_with_legs_turns_as_its_whole_length_bends(tmp_path):
    moved = '[support.tip]\nend = "end"\nrotation = [0, 0, 0.2]\n[analysis.statics]\n[measure.answer]\nmoment = "tip"'
    of = scene(tmp_path, TORSION, "section = {circle = 0.5}", HEAD, moved)
    wanted = np.linalg.inv(flexibility(line_of(of), 0.5)) @ [0, 0, 0, 0, 0, np.radians(0.2)]
    np.testing.assert_allclose(answer(of), wanted[3:], rtol=0, atol=3e-3 * np.linalg.norm(wanted[3:]))


def test_a_clock_spring_has_the_rate_of_its_whole_length_bent_evenly(tmp_path):
    """``E I / L``, and, held at both ends, with the forces that keep the arbor in its place."""
    of = scene(
        tmp_path,
        CLOCK,
        "section = {rounded_rectangle = {width = 0.2, height = 1.0, corner_radius = 0.02}}",
        "law = {LinearElastic = {E = 2.0e5, nu = 0.3}}",
        '[support.arbor]\nend = "start"\ncenter = [0, 0, 0]\nrotation = [0, 0, -0.5]\n[support.drum]\nend = "end"',
        '[analysis.statics]\n[measure.answer]\nstiffness = "arbor"',
    )
    line = line_of(of)
    # Of the rectangle with rounded corners.
    corner = 0.02**2 * (1.0 - np.pi / 4.0)
    bending = E * (1.0 * 0.2**3 / 12.0 - 4.0 * corner * (0.1 - 0.2234 * 0.02) ** 2)
    length = 2.0 * np.pi * 6.0 * 10.0
    assert answer(of) == pytest.approx(bending / length, rel=6e-3)
    # About the arbor's axis, forces there free to keep it in its place.
    gauss, weights = np.polynomial.legendre.leggauss(8)
    u = line.axis.within(0.5 * (gauss + 1.0)).ravel()
    places, slopes = evaluate(line.axis, line.centers, u)
    step = (0.5 * np.diff(line.axis.breaks)[:, None] * weights).ravel() * np.linalg.norm(slopes, axis=1)
    arms = np.stack([-places[:, 1], places[:, 0], np.ones(u.size)], axis=1)
    rate = np.linalg.inv(np.einsum("t,ti,tj->ij", step / bending, arms, arms))[2, 2]
    assert answer(of) == pytest.approx(rate, rel=3e-3)


def test_an_s_hook_stretches_as_curved_beams_do(tmp_path):
    """Winkler's and Bach's: ``pi F / (E A) (R^2 / e - R + 2 (1 + nu) R / k)`` of two half circles."""
    of = scene(tmp_path, S_HOOK, "section = {circle = 1.0}", HEAD, PULLED)
    radius, area = 10.0, np.pi
    offset = radius - 0.5 * (radius + np.sqrt(radius**2 - 1.0))
    shear = (6 + 12 * 0.3 + 6 * 0.09) / (7 + 3.6 + 0.36)
    wanted = np.pi * 0.01 / (E * area) * (radius**2 / offset - radius + 2.6 * radius / shear)
    assert answer(of) == pytest.approx(wanted, rel=1e-3)


def test_laws_in_a_list_are_those_of_pieces(tmp_path):
    """A cantilever of two straight pieces, the second half as stiff: ``F l^3 / (3 E I) (7 + 2)`` of lengths l."""
    laws = "law = [{LinearElastic = {E = 2e5, nu = 0.0}}, {LinearElastic = {E = 1e5, nu = 0.0}}]"
    pieces = "curve = {chain = [{straight = 40}, {straight = 40}]}\nsection = {circle = 1.0}"
    pulled = PULLED.replace("[0.0, 0.0, 0.01]", "[0.01, 0.0, 0.0]").replace('component = "z"', 'component = "x"')
    of = scene(tmp_path, pieces, HEAD.replace("law = {LinearElastic = {E = 2.0e5, nu = 0.3}}", laws), pulled)
    bent = 0.01 * 40.0**3 / (3.0 * E * 0.25 * np.pi) * 9.0
    assert answer(of) == pytest.approx(bent, rel=3e-3)
    other = "curve = {chain = [{straight = 40}, {straight = 40}, {arc = {radius = 5, angle = 90}}]}"
    from isorod import InputError

    with pytest.raises(InputError, match="got 2 laws for the 3 pieces of the curve, need one, or one for each"):
        scene(tmp_path, other, "section = {circle = 1.0}", laws, '[support.foot]\nend = "start"', PULLED).model()
