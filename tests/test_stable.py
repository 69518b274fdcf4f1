"""From unstable equilibria to stable ones: Euler's elastica, whatever else holds a bar, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import ON_RANKS
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk
from test_continuation import column, elastica
from test_unstable import SCENE, E, bar, pipe, pressed

from isorod import Contact, InputError, LinearElastic, Model, Plane, SolveError, Support, ellipse, statics
from isorod.command import cli
from isorod.statics import descent


def pushed(share, length):
    """Force on a clamped bar that is pushed by ``share`` times the way at which it buckles, over Euler's load.

    The elastica between inflections, twice, with the way of its axial strain along the chord.
    """
    strain = np.pi**2 / length**2

    def force(m):
        return (2.0 / np.pi * ellipk(m)) ** 2

    def gap(m):
        return (1.0 - strain * force(m)) * (2.0 * ellipe(m) / ellipk(m) - 1.0) - (1.0 - share * strain)

    return force(brentq(gap, 1e-12, 0.9, xtol=1e-15))


@pytest.mark.parametrize("share", [1.5, 4.0, 12.0])
def test_a_column_past_buckling_is_the_elastica_however_far_it_goes(share):
    """At twelve times Euler's load, where the straight one is unstable in two directions, its end has come below."""
    solution = statics.solve(column(200.0, share), stable=True)
    assert solution.negative_eigenvalues == 0
    tip = solution.at(0, 1.0) / 200.0
    # Theirs neither shortens nor shears: strains are of this size.
    strain = share * np.pi**2 / 16.0 / 200.0**2
    assert (abs(tip[0]), 1.0 + tip[2]) == pytest.approx(elastica(share), abs=1e-4 + 3.0 * strain)


@pytest.mark.parametrize("share", [1.01, 2.0, 10.0])
def test_force_on_a_pushed_bar_is_that_of_the_buckled_one(share):
    """The bar is round, and free to turn about its axis once it is bent, which counts as no direction."""
    errors = []
    for length in (60.0, 120.0):
        solution = statics.solve(bar(share, nu=0.0, length=length), stable=True)
        assert solution.negative_eigenvalues == 0
        euler = np.pi**3 * E / length**2
        assert solution.reactions[:, 2] == pytest.approx([-solution.reactions[1, 2], solution.reactions[1, 2]])
        errors.append(solution.reactions[0, 2] / euler / pushed(share, length) - 1.0)
    assert np.abs(errors) == pytest.approx(0.0, abs=2e-3)
    # What is left is shear, by the square of the thickness.
    assert abs((4.0 * errors[1] - errors[0]) / 3.0) < 2e-4


def test_what_is_stable_stays_as_it_is():
    found = [statics.solve(bar(0.9), stable=stable) for stable in (False, True)]
    np.testing.assert_array_equal(found[0].displacement, found[1].displacement)
    assert found[0].newton_iterations == found[1].newton_iterations


def test_pressures_and_pressure_that_follows():
    solution = statics.solve(bar(2.0, nu=0.4999, formulation="mixed"), stable=True)
    assert solution.negative_eigenvalues == 0
    # Held faces of what is incompressible make it a little shorter.
    assert solution.reactions[0, 2] == pytest.approx(np.pi**3 * E / 60.0**2, rel=0.015)
    space, body, loads = pipe(1.3)
    held = [Support.end(space, which) for which in ("start", "end")]
    solution = statics.solve(Model([body], held, loads=loads), stable=True)
    assert solution.negative_eigenvalues == 0
    assert np.abs(solution.displacement).max() > 0.5


@pytest.mark.filterwarnings("ignore:contact 0")
def test_planes_beside_a_bar_bear_on_its_bulge():
    free = bar(2.0, section=ellipse(8, 1.0, 1.3), order=2, elements=8)
    planes = [Contact(0, Plane((x, 0.0, 0.0), (-x, 0.0, 0.0)), penalty=1e5, points=(24, 12)) for x in (-1.5, 1.5)]
    between = replace(free, contacts=planes)
    forces = []
    for model in (free, between):
        solution = statics.solve(model, stable=True)
        assert solution.negative_eigenvalues == 0
        forces.append(solution.reactions[0, 2])
    assert abs(solution.at(0, 0.5)[0]) == pytest.approx(0.5, abs=0.01)
    assert max(one.force for one in solution.contacts) > 10.0
    # It has to bulge in more and shorter waves, but is not straight.
    straight = statics.solve(replace(between, contacts=[])).reactions[0, 2]
    assert forces[0] < 0.95 * forces[1] < 0.9 * straight


def test_what_tells_nothing_is_refused():
    for model in (bar(2.0, law=LinearElastic), pressed(friction=0.3)):
        with pytest.raises(InputError, match=r"stable: stability is unknown with .*friction, .* small-strain laws"):
            statics.solve(model, stable=True)


def test_where_none_is_found_nothing_is_answered(monkeypatch):
    monkeypatch.setattr(descent, "_STEPS", 2)
    with pytest.raises(SolveError, match="stable: no stable equilibrium: no equilibrium after 2 st"):
        statics.solve(bar(2.0), stable=True)


def test_a_file_and_the_command_on_any_number_of_ranks(tmp_path, capsys, on_ranks):
    file = tmp_path / "bar.toml"
    file.write_text(SCENE)
    said = on_ranks(2, ON_RANKS, "run", str(file), "--json", "--stable", "--no-estimate")
    assert "unstable" not in said
    records = [json.loads(said)]
    assert cli.main(["run", str(file), "--json", "--stable"]) == 0
    file.write_text(SCENE.replace("[analysis.statics]", "[analysis.statics]\nstable = true"))
    assert cli.main(["run", str(file), "--json", "--no-estimate"]) == 0
    said = capsys.readouterr()
    assert "unstable" not in said.err
    records += [json.loads(line) for line in said.out.splitlines()]
    assert [one["negative_eigenvalues"] for one in records] == [0, 0, 0]
    assert [one["settings"]["stable"] for one in records] == [True] * 3
    assert [one["force"] for one in records] == pytest.approx([records[0]["force"]] * 3, rel=1e-6)
