"""Derivatives with contact, while what is pressed stays so: identities of scale, runs beside, ranks."""

import pytest
from petsc4py import PETSc
from test_closer_hertz import ON_PIN
from test_rates import logarithmic

from isorod import files, statics
from isorod.design import derivatives, parameters
from isorod.statics.derivatives import Moving
from isorod.statics.differences import Unavailable

RING = """
[rod.ring]
curve = {arc = {radius = 40.0, angle = 180.0, phase = 180.0}}
section = {circle = 5.0}
law = {NeoHookean = {E = 10.0, nu = 0.4}}
space = {order = 2, elements = 12, degree = 4}

[support.left]
end = "start"
displacement = [0.0, -8.0, 0.0]

[support.right]
end = "end"
components = "yz"
displacement = [0.0, -8.0, 0.0]

[obstacle.floor]
Plane = {point = [0.0, -45.0, 0.0], normal = [0.0, 1.0, 0.0]}

[contact.floor]
first = "ring"
second = "floor"

[analysis.statics]

[measure.push]
reaction = "left"
component = "y"

[measure.widening]
displacement = "ring"
component = "x"
"""


IGNORED = pytest.mark.filterwarnings("ignore:contact 0. contact patch under-resolved", "ignore:derivatives of push")
RADIUS = "rod.ring.section.circle"


@IGNORED
def test_with_contact_they_scale(tmp_path):
    (tmp_path / "ring.toml").write_text(RING)
    scene = files.find(str(tmp_path / "ring.toml"))
    known = parameters.parameters(scene)
    lengths = ["rod.ring.curve.arc.radius", RADIUS, "obstacle.floor.Plane.point.1"]
    lengths += [f"support.{side}.displacement.1" for side in ("left", "right")]
    names = [*lengths, "rod.ring.law.NeoHookean.E"]
    with pytest.warns(UserWarning, match=r"derivatives of push are known to .* %: where a patch of contact rolls"):
        found = derivatives.of(scene, statics.solve(scene.model()), {name: known[name] for name in names})
    for measured, power, stiffness in (("push", 2.0, 1.0), ("widening", 1.0, 0.0)):
        assert sum(logarithmic(found, measured, one) for one in lengths) == pytest.approx(power, abs=2e-9)
        assert logarithmic(found, measured, names[-1]) == pytest.approx(stiffness, abs=2e-9)


GAS = '\n[load.gas]\nrod = "ring"\npressure = 0.02\nfollows = true\n'


@IGNORED
def test_with_pressures_that_follow_between_held_ends_they_scale(tmp_path):
    (tmp_path / "ring.toml").write_text(RING + GAS)
    scene = files.find(str(tmp_path / "ring.toml"))
    names = {"rod.ring.law.NeoHookean.E": 10.0, "load.gas.pressure": 0.02}
    found = derivatives.of(scene, statics.solve(scene.model()), names)
    for measured, power in (("push", 1.0), ("widening", 0.0)):
        assert sum(logarithmic(found, measured, one) for one in names) == pytest.approx(power, abs=2e-9)


@IGNORED
def test_with_pressures_that_follow_to_a_free_end_there_is_none_of_the_answer_itself(tmp_path):
    """Of what the end's edge makes of the tangent only the symmetric part is in the factors; differences are taken."""
    held = RING.index("[support.right]"), RING.index("[obstacle.floor]")
    text = RING[: held[0]].replace("-8.0", "-5.5") + RING[held[1] :] + GAS.replace("0.02", "0.001")
    (tmp_path / "ring.toml").write_text(text)
    scene = files.find(str(tmp_path / "ring.toml"))
    solution = statics.solve(scene.model())
    with pytest.raises(Unavailable, match="not available with contact and pressures that follow to a free end"):
        Moving(solution)


PIN = f'{ON_PIN}\n[measure.push]\nreaction = "back"\ncomponent = "y"\n'


def test_there_is_none_by_where_a_supported_patch_is(tmp_path):
    """Control points are held or not: answers would not change, and then jump."""
    (tmp_path / "pin.toml").write_text(PIN)
    known = parameters.parameters(files.find(str(tmp_path / "pin.toml")))
    assert {name for name in known if name.startswith("support")} == {"support.back.displacement.1"}


@pytest.mark.slow
@IGNORED
def test_they_are_of_the_spaces_that_see_a_patch(command, tmp_path):
    """The force is a modulus times a length squared, and the patch is seen on a space that the file does not have."""
    (tmp_path / "pin.toml").write_text(PIN)
    found = command.record("run", str(tmp_path / "pin.toml"), "--no-estimate", "--derivatives")
    by = {name: one["at"] * one["derivative"] / found["push"] for name, one in found["derivatives"]["push"].items()}
    assert by.pop("rod.bar.law.LinearElastic.E") == pytest.approx(1.0, abs=1e-8)
    lengths = [one for name, one in by.items() if not name.endswith((".nu", ".axis.0"))]
    assert sum(lengths) == pytest.approx(2.0, abs=1e-6)


@pytest.mark.slow
@IGNORED
def test_with_contact_they_are_those_of_runs_beside(tmp_path):
    (tmp_path / "ring.toml").write_text(RING)
    scene = files.find(str(tmp_path / "ring.toml"))
    found = derivatives.of(scene, statics.solve(scene.model()), {RADIUS: 5.0})
    ends = []
    for step in (-2e-3, 2e-3):
        moved = parameters.at(scene, {RADIUS: 5.0 * (1.0 + step)})
        ends.append(scene.measure(statics.solve(moved.model())))
    for measured in ("push", "widening"):
        change = (ends[1][measured] - ends[0][measured]) / (4e-3 * found.values[measured])
        assert logarithmic(found, measured, RADIUS) == pytest.approx(change, rel=5e-3)


def contact_on_two(path):
    scene = files.find(path)
    both, alone = (
        derivatives.of(scene, statics.solve(scene.model(), comm=comm), {RADIUS: 5.0})
        for comm in (PETSc.COMM_WORLD, PETSc.COMM_SELF)
    )
    for measured in ("push", "widening"):
        one, other = (logarithmic(each, measured, RADIUS) for each in (both, alone))
        assert one == pytest.approx(other, abs=1e-6)


@pytest.mark.slow
def test_ranks_find_the_same_with_contact(on_ranks, tmp_path):
    (tmp_path / "ring.toml").write_text(RING)
    on_ranks(2, f"test_rates_contact.contact_on_two({str(tmp_path / 'ring.toml')!r})")
