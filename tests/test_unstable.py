"""Equilibria that are not stable are told so: in how many directions, by closed forms of buckling."""

import json
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from conftest import ON_RANKS, straight

from isorod import LinearElastic, NeoHookean, Space, circle, ellipse, statics
from isorod.command import cli
from isorod.geometry import center_line
from isorod.model import Body, Contact, Model, Plane, Pressure, SectionLoad, Support

E, LENGTH = 2.1e5, 60.0


def bar(share, section=None, nu=0.3, formulation=None, law=NeoHookean, length=LENGTH, **space):
    """A bar clamped at both ends, pushed by ``share`` times the way at which one of radius 1 buckles."""
    space = Space(center_line.straight(length).sweep(circle(8) if section is None else section), **space)
    # Euler's strain with half the length.
    way = share * np.pi**2 / length**2 * length
    supports = [Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, -way))]
    return Model([Body(space, law(E, nu), formulation=formulation)], supports)


def negative(model, **options):
    """Return the count, which the warning says too."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        solution = statics.solve(model, **options)
    texts = [str(one.message) for one in said if "unstable" in str(one.message)]
    assert len(texts) == bool(solution.negative_eigenvalues)
    assert solution.record()["negative_eigenvalues"] == solution.negative_eigenvalues
    if texts:
        many = f"has {solution.negative_eigenvalues} negative eigenvalue" + "s" * (solution.negative_eigenvalues > 1)
        assert f"{many}, " in texts[0]
    return solution.negative_eigenvalues


# A round bar buckles in two directions at once, next at 8.18 pi^2 EI / l^2; one of an ellipse in its plane first.
@pytest.mark.parametrize(
    ("share", "section", "expected"),
    [
        (0.95, None, 0),
        (1.05, None, 2),
        (1.9, None, 2),
        (2.2, None, 4),
        (1.2, ellipse(8, 1.0, 1.2), 1),
        (1.6, ellipse(8, 1.0, 1.2), 2),
    ],
)
def test_a_bar_is_unstable_in_as_many_directions_as_it_is_past_buckling_loads(share, section, expected):
    assert negative(bar(share, section)) == expected


def test_pressures_of_the_mixed_formulation_are_not_counted():
    for share, expected in ((0.9, 0), (1.2, 2)):
        assert negative(bar(share, nu=0.4999, formulation="mixed")) == expected


@pytest.mark.parametrize(
    "options",
    [
        {"pc_type": "lu"},
        {"pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"},
        # The predictor is good enough: its tangent, of the state of rest, has no negative eigenvalue.
        {"snes_atol": 1e9},
    ],
    ids=str,
)
def test_whatever_was_factorised_last(options):
    assert [negative(bar(share), petsc=options) for share in (0.9, 1.2)] == [0, 2]


def test_softest_directions_of_a_state_before_are_not_believed(monkeypatch):
    """Without the question at the equilibrium itself, the predictor's factors would vouch for a state past buckling."""
    monkeypatch.setattr(statics.stability, "_holds", lambda solver: True)
    assert negative(bar(1.2), petsc={"snes_atol": 1e9}) == 0


def test_what_is_stable_takes_no_factors_more(monkeypatch):
    monkeypatch.setattr(statics.stability.inertia, "negative_eigenvalues", lambda matrix: pytest.fail("factorised"))
    assert negative(bar(0.9)) == 0


def pipe(share):
    """A held pipe under a pressure that follows its inside: what it is pressed with along is ``p A`` of its hole."""
    length, law = 100.0, NeoHookean(100.0, 0.0)
    space = Space(
        center_line.straight(length).sweep(circle(8)).with_rings((0.8, 1.0)), elements=4, degree=4, section_degree=3
    )
    pressure = share * 4.0 * np.pi**2 * law.E * np.pi / 4.0 * (1.0 - 0.8**4) / length**2 / (np.pi * 0.64)
    return space, Body(space, law), [Pressure(pressure, "inner", follows=True)]


def test_pressure_within_a_held_pipe_lets_it_buckle():
    for share, expected in ((0.9, 0), (1.1, 2)):
        space, body, loads = pipe(share)
        held = [Support.end(space, which) for which in ("start", "end")]
        assert negative(Model([body], held, loads=loads)) == expected


def test_what_has_no_energy_is_not_counted():
    space, body, loads = pipe(0.1)
    assert negative(Model([body], [Support.end(space, "start")], loads=loads)) is None
    assert negative(bar(2.0, law=LinearElastic)) is None
    assert negative(pressed(friction=0.3)) is None


def pressed(**contact):
    """A short bar whose side a load presses on a plane."""
    space = Space.paper(straight(8, breaks=(0.0, 1.0, 2.0), height=8.0), degree=2, order=2, quadrature="auto")
    held, load = Support.end(space, "start"), SectionLoad.end(space, "end", (0.0, -1.0, 0.0))
    plane = Plane((0.0, -1.1, 0.0), (0.0, 1.0, 0.0))
    touching = [Contact(0, plane, penalty=1e3, points=(24, 12), **contact)]
    return Model([Body(space, NeoHookean(1000.0, 0.3))], [held], contacts=touching, loads=[load])


def test_contact_is_counted_with_the_bodies():
    assert negative(pressed()) == 0
    # A plane that the bar does not reach yet.
    model = bar(1.2, order=2)
    plane = Plane((0.0, -5.0, 0.0), (0.0, 1.0, 0.0))
    assert negative(replace(model, contacts=[Contact(0, plane, penalty=1e3, points=(24, 12))])) == 2


SCENE = """
[rod.bar]
curve = {straight = {length = 60.0}}
section = {circle = {radius = 1.0}}
law = {NeoHookean = {E = 2.1e5, nu = 0.3}}
[support.wall]
end = "start"
[support.push]
end = "end"
displacement = [0.0, 0.0, -0.3]
[analysis.statics]
[measure.force]
reaction = "wall"
component = "z"
"""


def test_a_file_is_warned_of_on_any_number_of_ranks(tmp_path, capsys, on_ranks):
    file = tmp_path / "bar.toml"
    file.write_text(SCENE)
    words = "run", str(file), "--json", "--no-estimate"
    assert cli.main([*words]) == 0
    for said in ("".join(capsys.readouterr()), on_ranks(2, ON_RANKS, *words)):
        (record,) = re.findall("^{.*}$", said, re.MULTILINE)
        assert json.loads(record)["negative_eigenvalues"] == 2
        assert len(re.findall("warning: the equilibrium is unstable: .* has 2 negative eigenvalues", said)) == 1
