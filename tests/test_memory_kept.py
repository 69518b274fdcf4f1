"""States of laws with memory in statics: checkpoints, modes about them, fields, measures, what is dissipated."""

import numpy as np
import pytest
from refused import refused

from isorod import (
    Body,
    Contact,
    InputError,
    Model,
    NeoHookean,
    Plane,
    Space,
    Support,
    Thermal,
    UserMaterial,
    circle,
    modal,
    statics,
    straight,
)
from isorod.material.plastic import Plastic
from isorod.material.viscous import Viscoelastic
from isorod.output import checkpoint, vtk

E, NU, YIELD = 200e3, 0.3, 400.0
G, SHEAR = E / (2.0 + 2.0 * NU), YIELD / np.sqrt(3.0)
METAL = Plastic(E, NU, [[0.0, YIELD], [1.0, 2000.0]], 1000.0)


def model(law=METAL, length=4.0, end=None, radius=1.0, **space) -> Model:
    """Return a bar that is pulled and twisted, and let go by half and to the other side."""
    given = {"section_degree": 3, "elements": 3, "degree": 3} | space
    made = Space(straight(length).sweep(circle(8, radius)), **given)
    moved = {"displacement": (0.0, 0.0, 0.02), "turn": (0.0, 0.0, 0.03), "history": [[0, 0], [1, 1], [2, -0.5]]}
    return Model([Body(made, law, 1.0)], [Support.end(made, "start"), Support.end(made, "end", **(end or moved))])


@pytest.mark.parametrize("nu", [0.3, 0.5])
def test_load_steps_that_were_stopped_go_on_to_the_last_bit(nu, tmp_path, monkeypatch) -> None:
    law = Plastic(E, nu, [[0.0, YIELD], [1.0, 2000.0]], 1000.0)
    asked, file = model(law, quadrature="6x2x4"), tmp_path / "state"

    def run(**kept):
        return statics.solve(asked, 4, end_time=2.0, keep=True, **kept)

    whole, true, count = run(), checkpoint.write, []

    def write(*given):
        true(*given)
        count.append(1)
        if len(count) == 6:
            raise KeyboardInterrupt

    monkeypatch.setattr(checkpoint, "write", write)
    with pytest.raises(KeyboardInterrupt) as stopped:
        run(checkpoint=file, every=0.0)
    assert "has time 1.25, --resume goes on from there" in stopped.value.__notes__[0]
    for _ in range(2):
        # From where it was, and once more when all is done.
        again = run(checkpoint=file, resume=True)
        for name in ("displacement", "reactions", "moments", "work", "newton_iterations", "load_steps"):
            np.testing.assert_array_equal(getattr(again, name), getattr(whole, name), name)
        np.testing.assert_array_equal(again.state("p", 0, 0.5, (0.9, 0.0)), whole.state("p", 0, 0.5, (0.9, 0.0)))
        for one, other in zip(again.path, whole.path, strict=True):
            np.testing.assert_array_equal(one.moments, other.moments)
        assert again.record()["dissipated"] == whole.record()["dissipated"]
    with pytest.raises(InputError, match="belongs to another run: settings"):
        statics.solve(asked, 5, end_time=2.0, keep=True, checkpoint=file, resume=True)
    with pytest.raises(InputError, match="belongs to another model"):
        statics.solve(model(quadrature="6x2x5"), 4, end_time=2.0, keep=True, checkpoint=file, resume=True)


def _routine(softening=0.4):
    def damaged(F_old, F, state, dt, constants):
        growth, inverse = np.log(np.linalg.det(F)), np.linalg.inv(F).T
        state[0] = max(state[0], np.sum(F * F) - 3 - 2 * growth)
        return np.exp(-softening * state[0]) * (F - inverse + growth * inverse)

    return UserMaterial(damaged, 1)


@pytest.mark.parametrize("law", [_routine, lambda: Thermal(METAL, 1e-5, 50.0)], ids=["routine", "warm"])
def test_addresses_of_routines_may_be_others(law, tmp_path, monkeypatch) -> None:
    """As they are in the next process: the law made anew has another routine, or other functions compiled."""
    file, space = tmp_path / "state", {"quadrature": "12x4x4", "elements": 2}

    whole = statics.solve(model(law(), **space), 2, end_time=2.0)
    true = checkpoint.write

    def write(*given):
        true(*given)
        if float(given[-1]["reached"][0]) > 0.3:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(checkpoint, "write", write)
        statics.solve(model(law(), **space), 2, end_time=2.0, checkpoint=file, every=0.0)
    again = statics.solve(model(law(), **space), 2, end_time=2.0, checkpoint=file, resume=True)
    np.testing.assert_array_equal(again.displacement, whole.displacement)


def test_without_memory_too(tmp_path) -> None:
    made, file = model(), tmp_path / "state"
    elastic = Model([Body(made.bodies[0].space, NeoHookean(E, NU))], made.supports)
    whole = statics.solve(elastic, 4, end_time=2.0)
    first = statics.solve(elastic, 4, end_time=2.0, checkpoint=file, every=0.0)
    again = statics.solve(elastic, 4, end_time=2.0, checkpoint=file, resume=True)
    for one in (first, again):
        np.testing.assert_array_equal(one.displacement, whole.displacement)


def test_a_bar_that_was_drawn_swings_as_one_of_its_length() -> None:
    # Free of force again: the elastic waves of a longer and thinner bar of as much mass.
    law, all_of_it = Plastic(E, NU, [[0.0, YIELD], [1.0, YIELD + 2000.0]]), 0.022
    strain, most = (all_of_it - YIELD / E) / (1.0 + 2000.0 / E), np.exp(all_of_it) - 1.0
    way = {"displacement": (0.0, 0.0, 10.0 * most), "components": "z"}
    asked = model(law, 10.0, way | {"history": [[0, 0], [1, 1], [2, (np.exp(strain) - 1.0) / most]]})
    found = statics.solve(asked, 4, end_time=2.0)
    assert abs(found.reactions[1, 2]) < 0.01 * np.pi * YIELD
    modes, rest = modal.solve(asked, 8, state=found), modal.solve(asked, 8, at_rest=True)
    assert modes.about.endswith("elastic from there: nothing flows")
    # Of the waves along the axis the first: both ends are held along.
    axial, before = (
        min(one.frequencies, key=lambda it: abs(it - 0.5 * np.sqrt(E) / length))
        for one, length in ((modes, 10.0 * np.exp(strain)), (rest, 10.0))
    )
    # At the clamp, where it cannot become thinner, it is drawn by less.
    assert axial / before == pytest.approx(np.exp(-strain), rel=4e-3)


def test_what_relaxes_swings_as_stiff_as_it_is_at_once() -> None:
    # Shear that is held relaxes; small twists about it do not.
    law, end = Viscoelastic(E, NU, [[0.5, 1.0]]), {"turn": (0.0, 0.0, 1e-4), "history": [[0, 1], [9, 1]]}
    asked = model(law, 10.0, end)
    relaxed, fresh = modal.solve(asked, 3, end_time=9.0), modal.solve(asked, 3, at_rest=True)
    assert relaxed.frequencies == pytest.approx(fresh.frequencies, rel=1e-4)
    assert "active muscles" not in relaxed.about


def test_closed_cycles_lose_the_area_of_their_loop() -> None:
    # 8 pi (1 - g) [x (1 - rp^3)/3 - (1 - rp^2)/2] tau_y^2 R^2/G a length, of linear kinematic hardening.
    x, g = 2.0, 0.1
    turn = {"turn": (0.0, 0.0, 4.0 * x * SHEAR / G), "history": [[0, 0], [1, 1], [3, -1], [5, 1]]}
    law = Plastic(E, NU, [[0.0, YIELD]], 3.0 * G * g / (1.0 - g))
    found = statics.solve(model(law, end=turn), 2, end_time=5.0, keep=True)
    lost = {time: one.dissipated(0) for time, one in found.frames()}
    assert lost[5.0] - lost[1.0] == pytest.approx(4.7123889804 * SHEAR**2 / G * 4.0, rel=5e-3)
    assert found.record()["dissipated"] == lost[5.0]


def test_cycles_of_what_relaxes_lose_what_the_loss_modulus_says() -> None:
    # pi G'' J theta^2 a length and cycle, once it goes round; G'' = g G w tau / (1 + w^2 tau^2).  Of a sine in straight
    # pieces the first harmonic is smaller.
    times = np.linspace(0.0, 4.0 * np.pi, 49)
    end = {"turn": (0.0, 0.0, 4e-3), "history": np.column_stack([times, np.sin(times)]).tolist()}
    asked = model(Viscoelastic(E, NU, [[0.5, 1.0]]), end=end, quadrature="4x2x4", elements=2)
    found = statics.solve(asked, 1, end_time=times[-1], keep=True)
    lost = {round(time / np.pi, 3): one.dissipated(0) for time, one in found.frames()}
    area = np.sinc(1.0 / 24.0) ** 4 * np.pi * 0.25 * G * 0.5 * np.pi * 1e-6 * 4.0
    assert lost[4.0] - lost[2.0] == pytest.approx(area, rel=3e-3)


def test_fields_and_measures(command, tmp_path) -> None:
    path = tmp_path / "bar.toml"
    path.write_text(
        "[rod.bar]\ncurve = {straight = 4.0}\nsection = {circle = 1.0}\n"
        "law = {Plastic = {E = 200e3, nu = 0.3, hardening = [[0, 400], [1, 2000]]}}\n"
        "space = {section_degree = 3, elements = 2, degree = 3}\n"
        '[support.a]\nend = "start"\n[support.b]\nend = "end"\nrotation = [0, 0, 1.4]\n[analysis.statics]\n'
        '[measure.flown]\nstate = "bar"\nname = "p"\n'
        '[measure.middle]\nstate = "bar"\nname = "p"\nu = 0.5\nxi = [0, 0]\n'
        '[measure.shear]\nstate = "bar"\nname = "plastic_strain"\ncomponent = "yz"\nu = 0.5\nxi = [1, 0]\n'
        '[measure.loss]\ndissipated = "bar"\n'
    )
    record = command.record("run", path, "--no-estimate")
    assert record["middle"] == 0.0
    assert record["flown"] == pytest.approx(2.0 / np.sqrt(3.0) * record["shear"], rel=1e-2)
    assert record["loss"] == record["dissipated"] > 0.0


def test_states_of_layers_of_which_one_has_a_memory(command, tmp_path) -> None:
    """The largest is in that layer; where the other is there is none, which a line says."""
    path = tmp_path / "bar.toml"
    path.write_text(
        "[rod.bar]\ncurve = {straight = 4.0}\nsection = {circle = 1.0}\nrings = [0.0, 0.5, 1.0]\n"
        "law = [{Plastic = {E = 200e3, nu = 0.3, hardening = [[0, 400], [1, 2000]]}}, "
        "{NeoHookean = {E = 200e3, nu = 0.3}}]\n"
        "space = {section_degree = 2, elements = 1, degree = 2}\n"
        '[support.a]\nend = "start"\n[support.b]\nend = "end"\nrotation = [0, 0, 1.4]\n[analysis.statics]\n'
        '[measure.flown]\nstate = "bar"\nname = "p"\n'
    )
    record = command.record("run", path, "--no-estimate")
    assert record["flown"] > 0.0
    assert record["places"]["flown"]["radius"] == pytest.approx(0.5, abs=1e-3)
    beyond = "u = 0.5\nxi = [0.8, 0]\n"
    path.write_text(path.read_text() + beyond)
    assert "measure.flown.name: the law at u = 0.5, xi = [0.8, 0.0] has no 'p'" in command.refuses("run", path)


def test_states_stand_in_files_of_fields() -> None:
    found = statics.solve(model(), 2, end_time=1.0)
    mesh = vtk.grid(found.model.bodies[0], found.fields(0), curved=True)
    assert mesh.point_data["plastic_strain"].shape == (mesh.n_points, 6)
    k = int(np.argmax(mesh.point_data["p"]))
    u, xi = mesh.field_data["u"], mesh.field_data["xi"]
    place = u[k // len(xi)], xi[k % len(xi)]
    assert mesh.point_data["p"][k] == pytest.approx(found.state("p", 0, *place)[0], rel=1e-9)
    # VTK's order: the trace is that of the first three.
    assert np.abs(mesh.point_data["plastic_strain"][:, :3].sum(axis=1)).max() < 1e-12
    two = Viscoelastic(E, NU, [[0.3, 1.0], [0.2, 0.1]])
    found = statics.solve(model(two), 2, end_time=1.0)
    assert {"viscous_strain_1", "viscous_strain_2"} <= {*vtk.grid(found.model.bodies[0], found.fields(0)).point_data}


def _touching() -> Model:
    one = model()
    return Model(one.bodies, one.supports, contacts=[Contact(0, Plane((0.0, 0.0, 9.0), (0.0, 0.0, -1.0)))])


test_what_is_refused = refused(
    (
        lambda: statics.solve(_touching(), 4, end_time=1.0, checkpoint="x"),
        "checkpoint: statics keeps none with contact, ties, mean supports or finite element bodies",
    ),
    (
        lambda: statics.solve(model(), end_time=2.0, checkpoint="x"),
        "checkpoint: give load steps, which else are doubled",
    ),
    (lambda: statics.solve(model(), end_time=2.0, resume=True), "resume: got no checkpoint"),
    (lambda: statics.solve(model(), 4, end_time=2.0, checkpoint="x", every=-1.0), "time between checkpoints: got -1"),
)
