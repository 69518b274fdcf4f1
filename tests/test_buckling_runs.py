"""Buckling from the command line and from Python: what is printed and kept, and what is refused in one line."""

import json

import numpy as np
import pytest
from refused import refused

from isorod import (
    Axis,
    InputError,
    LinearElastic,
    NeoHookean,
    Rod,
    SolveError,
    Space,
    buckling,
    circle,
    statics,
    straight,
)
from isorod.command.cli import main
from isorod.model import Body, BodyForce, Contact, EndFace, Model, Plane, Pressure, SectionLoad, Spin, Support, Tie
from isorod.statics import continuation

FILE = """title = "a column"
analysis = {buckling = {modes = 2}}
[rod.column]
curve = {straight = 60.0}
section = {ellipse = {a = 2.0, b = 1.5}}
law = {NeoHookean = {E = 2.1e5, nu = 0.3}}
[support.foot]
end = "start"
[load.press]
end = "end"
force = [0.0, 0.0, -1000.0]
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "column.toml"
    path.write_text(FILE)
    return str(path)


def column(rod=None, force=(0.0, 0.0, -1.0), **body):
    """A column clamped at its start, pressed at its end."""
    space = Space(straight(40.0).sweep(circle(8)) if rod is None else rod, elements=4, degree=4, section_degree=3)
    body = {"material": NeoHookean(1000.0, 0.3)} | body
    return Model([Body(space, **body)], [Support.end(space, "start")], loads=[SectionLoad.end(space, "end", force)])


def test_what_is_printed_and_kept(file, tmp_path, capsys):
    folder = str(tmp_path / "results")
    assert main(["run", file, "--output", folder]) == 0
    lines = capsys.readouterr().out.splitlines()
    told = {line[:20].strip(): line[20:] for line in lines if line[0] != " "}
    assert told["factors"].endswith("(times the loads and moved supports)")
    assert told["critical load"].endswith("(force of load press)")
    assert told["mode 1"].startswith("moves most at u = 1, radius 1")
    assert told["about"] == "the equilibrium at each load factor"
    assert "finer space" in told["error"] and "linear" in told
    (record,) = [json.loads(line) for line in open(f"{folder}/results.jsonl")]
    first, second = record["factors"]
    assert second / first == pytest.approx((2.0 / 1.5) ** 2, rel=0.01)
    assert record["below"] == [0, 1] and record["settled"] < 1e-8 and record["error_estimate"] < 5e-3
    assert record["critical_loads"] == pytest.approx([1000.0 * first, 1000.0 * second])
    assert record["largest"][0]["u"] == pytest.approx(1.0) and record["linear"] == pytest.approx(
        [first, second], rel=0.02
    )
    picture = str(tmp_path / "mode.png")
    assert main(["plot", folder, "--mode", "2", "--png", picture]) == 0
    assert main(["run", file, "--linear-at", "0", "--modes", "1", "--json"]) == 0
    record = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert record["factors"] == record["linear"] and record["about"] == "the state of rest (linear)"
    assert main(["run", file, "--linear-at", "0"]) == 0
    assert "no estimate: linear factors of the state of rest have none" in capsys.readouterr().out


def test_spaces_are_refined_to_a_tolerance(file, capsys):
    assert main(["run", file, "--elements", "1", "--degree", "2", "--modes", "1", "--tolerance", "1e-3", "--json"]) == 0
    record = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert record["error_estimate"] <= 1e-3 and record["refinements"]


def test_factors_know_no_place_and_no_direction():
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    start = np.array([7.0, -4.0, 9.0])
    rod = straight(start=start, end=start + 40.0 * turn[:, 2]).sweep(circle(8))
    moved = buckling.solve(column(rod, tuple(-turn[:, 2])), modes=2)
    still = buckling.solve(column(), modes=2)
    assert moved.factors == pytest.approx(still.factors, rel=1e-7)
    # Nor do they know the size of what loads.
    small = buckling.solve(column(force=(0.0, 0.0, -1e-6)))
    assert small.factors[0] == pytest.approx(1e6 * still.factors[0], rel=1e-7)


def test_a_finer_space_changes_next_to_nothing_and_the_estimate_says_so():
    rod = straight(40.0).sweep(circle(8))
    factors, estimates = [], []
    for elements, degree in ((1, 2), (12, 5)):
        space = Space(rod, elements=elements, degree=degree, section_degree=3)
        model = Model(
            [Body(space, NeoHookean(1000.0, 0.3))],
            [Support.end(space, "start")],
            loads=[SectionLoad.end(space, "end", (0.0, 0.0, -1.0))],
        )
        found = buckling.solve(model)
        factors.append(found.factors[0])
        estimates.append(found.estimate("axis"))
    error = factors[0] / factors[1] - 1.0
    print(error, estimates)
    assert error > 0.005 and error / 3.0 < estimates[0] < 3.0 * error
    assert estimates[1] < 1e-3


def test_a_nearly_incompressible_column_buckles_as_others_do():
    """By pressures, and by displacements where these do not lock."""
    mixed = buckling.solve(column(material=NeoHookean(1000.0, 0.49), formulation="mixed"), modes=2)
    plain = buckling.solve(column(material=NeoHookean(1000.0, 0.49), formulation="displacement"), modes=2)
    assert mixed.factors == pytest.approx(plain.factors, rel=0.02)
    assert mixed.below == [0, 0] and mixed.linear == pytest.approx(mixed.factors, rel=5e-3)
    rubber = buckling.solve(column(material=NeoHookean(1000.0, 0.5)))
    assert rubber.factors[0] == pytest.approx(mixed.factors[0], rel=5e-3)


def arch(rise, upright=False):
    """A clamped parabolic arch of span 100 and radius 1 under a force at its crown, which may stay upright."""
    slope, turns = 4.0 * rise / 100.0, []
    for one in (slope, 0.0, -slope):
        t, y = np.array([1.0, 0.0, one]) / np.hypot(1.0, one), np.array([0.0, 1.0, 0.0])
        turns.append(np.stack([y, np.cross(t, y), t], axis=1))
    axis = Axis(2, np.repeat([0.0, 1.0], 3), np.ones(3))
    centers = np.array([[-50.0, 0.0, 0.0], [0.0, 0.0, 2.0 * rise], [50.0, 0.0, 0.0]])
    space = Space(Rod.sweep(circle(4), axis, centers, np.array(turns)), elements=8, degree=4, section_degree=3)
    ends = [Support.end(space, end) for end in ("start", "end")]
    crown = space.layers // 2 * space.layer_nodes + np.arange(space.layer_nodes)
    ends += [Support(crown, "xy")] if upright else []
    return Model([Body(space, NeoHookean(1.0, 0.3))], ends, loads=[SectionLoad((0.0, 0.0, -1e-3), u=0.5)])


@pytest.mark.parametrize("rise", [10.0, 20.0])
def test_arches_leave_their_path_where_continuation_says(rise):
    """By its bisection; an arch bends much before it does."""
    found = buckling.solve(arch(rise))
    assert found.factors[0] == pytest.approx(continuation.critical(arch(rise), 0.2, 5.0).factor, rel=1e-6)
    assert abs(found.linear[0] / found.factors[0] - 1.0) > 0.005


@pytest.mark.parametrize(("rise", "said"), [(5.0, "limit point"), (2.0, "no factor 1 up to .* stiffens")])
def test_an_arch_that_snaps_through_or_stiffens_is_refused_in_one_line(rise, said):
    with pytest.raises(SolveError, match=said) as caught:
        buckling.solve(arch(rise, upright=True))
    assert "\n" not in str(caught.value)
    assert "--stable continues" in str(caught.value) and "linear_at" in str(caught.value)
    assert buckling.solve(arch(rise, upright=True), linear_at=0.0).factors[0] > 0.0


def test_welded_bars_buckle_as_one_does():
    def bars(*lengths):
        spaces, height = [], 0.0
        for length in lengths:
            rod = straight(start=(0.0, 0.0, height), end=(0.0, 0.0, height + length)).sweep(circle(8))
            spaces.append(Space(rod, elements=round(length / 5.0), degree=4, section_degree=3))
            height += length
        bodies = [Body(space, NeoHookean(1000.0, 0.0)) for space in spaces]
        last = len(bodies) - 1
        load = SectionLoad.end(spaces[-1], "end", (0.0, 0.0, -1.0), body=last)
        ties = [Tie(EndFace(k, "start"), EndFace(k - 1, "end")) for k in range(1, last + 1)]
        return Model(bodies, [Support.end(spaces[0], "start")], loads=[load], ties=ties)

    one, two = (buckling.solve(bars(*lengths), modes=2) for lengths in ((40.0,), (20.0, 20.0)))
    assert two.factors == pytest.approx(one.factors, rel=1e-8) and two.linear == pytest.approx(one.linear, rel=1e-8)
    assert two.places[0]["body"] == 1.0


def two_ranks():
    """Run by both ranks."""
    from petsc4py import PETSc

    own = buckling.solve(column(), modes=2, comm=PETSc.COMM_SELF)
    both = buckling.solve(column(), modes=2)
    assert both.ranks == 2
    np.testing.assert_allclose(both.factors, own.factors, rtol=1e-8)
    np.testing.assert_allclose(both.linear, own.linear, rtol=1e-8)


def test_two_ranks_have_the_same_factors(on_ranks):
    on_ranks(2, "test_buckling_runs.two_ranks()")


def test_modes_answer_for_any_point_of_them():
    found = buckling.solve(column(), modes=2)
    assert len(found) == 2 and [one.number for one in found] == [0, 1]
    mode = found[0]
    assert mode.factor == found.factors[0] and "load factor" in repr(mode) and "load factors" in repr(found)
    # About the column as it is pressed there.
    assert mode.position(0, "end", scale=0.0)[2] < 40.0
    assert np.linalg.norm(mode.at(0, "end")) == pytest.approx(1.0, rel=0.01)
    assert found.curves()["load factor"] == pytest.approx(found.factors)
    assert {"mode_1", "mode_2", "displacement"} <= found.fields(0).keys()
    equilibrium = statics.solve(column(force=(0.0, 0.0, -0.9 * found.factors[0])))
    assert equilibrium.negative_eigenvalues == 0
    with pytest.warns(UserWarning, match="2 negative eigenvalues"):
        statics.solve(column(force=(0.0, 0.0, -1.1 * found.factors[0])))


test_what_has_no_load_factors_is_refused_in_one_line = refused(
    (column(force=(0.0, 0.0, 0.0)), {}, "nothing loads the model"),
    (column(force=(0.0, 0.0, 1.0)), {}, "never make the tangent stiffness singular"),
    (column(material=LinearElastic(1000.0, 0.3)), {}, "body 0 is linear elastic, without geometric stiffness"),
    (column(), {"modes": 0}, "modes: got 0, need an integer from 1"),
    (column(), {"linear_at": -1.0}, "linear_at: got -1, need a load factor from 0 on"),
    (column(), {"linear_at": 2.0}, "linear_at 2 is beyond 2 load factors"),
    (column(force=(0.3, 0.0, -1.0)), {}, "the path bends before factor 1"),
    by=lambda model, settings: buckling.solve(model, **settings),
    error=(InputError, SolveError),
)


def test_what_is_not_known_is_refused_in_one_line():
    rod = straight(10.0).sweep(circle(6))
    space = Space(rod, elements=2, degree=3)
    body, end = Body(space, NeoHookean(1000.0, 0.3), 1.0), Support.end(space, "start")
    pressed = Support.end(space, "end", displacement=(0.0, 0.0, -1.0), during=(0.0, 0.5))
    for model, said in (
        (Model([body], [end], contacts=[Contact(0, Plane((0.0, 0.0, 20.0), (0.0, 0.0, -1.0)))]), "contact"),
        (Model([body], [end], Spin((1.0, 0.0, 0.0))), "a spin"),
        (
            Model([body], [end, Support.end(space, "end")], loads=[SectionLoad.end(space, "end", (0.0, 0.0, -1.0))]),
            "the loads act on what supports hold alone",
        ),
        (Model([body], [end, pressed]), "'during'"),
        (Model([body], [end], loads=[Pressure(1.0, follows=True)]), "is symmetric only if"),
        (Model([body], loads=[BodyForce((0.0, 0.0, 1.0))]), "free"),
    ):
        with pytest.raises((InputError, SolveError), match=said) as caught:
            buckling.solve(model)
        assert "\n" not in str(caught.value)
