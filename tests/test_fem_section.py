"""Sections by finite elements: exact ones, and isorod's stiffness and mass of those that have no closed form."""

import json

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import isorod
from comparisons.fem.section import main, solve
from isorod.errors import InputError
from isorod.output.section_properties import apart

LAW = isorod.LinearElastic(E=210.0, nu=0.3)
CORE = isorod.LinearElastic(E=20.0, nu=0.45)


def body(outline, rings=(0.0, 1.0), material=LAW):
    rod = isorod.straight(10.0).sweep(outline).with_rings(rings)
    return isorod.Body(isorod.Space(rod, section_degree=6), material, density=2.0)


def test_circle():
    """The closed form, shear included, to what the mesh's edges are off; finer meshes are nearer."""
    r, errors = 0.8, []
    area, inertia, nu = np.pi * r**2, np.pi / 4 * r**4, LAW.nu
    shear = 6 * (1 + nu) ** 2 / (7 + 14 * nu + 8 * nu**2) * LAW.mu * area
    exact = np.diag([LAW.E * area, shear, shear, 2 * LAW.mu * inertia, LAW.E * inertia, LAW.E * inertia])
    mass = 2.0 * np.diag([area, area, area, 2 * inertia, inertia, inertia])
    for level in (1, 2):
        found = solve(body(isorod.circle(8, r)), 0.5, level)
        errors.append(apart(exact, found.stiffness))
        assert apart(mass, found.mass) < 2 * errors[-1]
    assert errors[1] < 3e-4
    assert errors[1] < 0.1 * errors[0]


def test_layers():
    own = isorod.section_properties(body(isorod.circle(8), (0.0, 0.6, 1.0), [CORE, LAW]))
    found = solve(body(isorod.circle(8), (0.0, 0.6, 1.0), [CORE, LAW]), 0.0, 4)
    assert apart(own.stiffness, found.stiffness) < 5e-5
    assert apart(own.mass, found.mass) < 5e-5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("outline", "rings", "material", "error"),
    [
        (isorod.airfoil(), (0.0, 1.0), LAW, 1e-4),
        (isorod.naca("2412", 24), (0.0, 1.0), LAW, 1e-3),
        (isorod.flower(), (0.0, 1.0), LAW, 5e-4),
        (isorod.ellipse(8, 1.0, 0.4), (0.6, 1.0), LAW, 5e-5),
        (isorod.airfoil(), (0.6, 1.0), LAW, 2e-3),
        (isorod.airfoil(), (0.0, 0.6, 1.0), [CORE, LAW], 1e-3),
    ],
)
def test_sections_without_a_closed_form(outline, rings, material, error):
    """Within the error that isorod estimates too, but for that of the mesh."""
    one = body(outline, rings, material)
    own = isorod.section_properties(one)
    coarse, fine = (solve(one, 0.0, level).stiffness for level in (3, 6))
    assert apart(fine, own.stiffness) < error
    assert apart(fine, own.stiffness) < 1.5 * own.error + apart(coarse, fine)


def test_the_papers_airfoil(capsys):
    """As the command compares them: all of the stiffness within 0.1 %, at places where the blade is turned too."""
    for u, level in ((0.0, "4"), (0.7, "4")):
        assert main(["blade", "--u", str(u), "--level", level]) == 0
        record = json.loads(capsys.readouterr().out)
        assert record["apart"] < 5e-4
        found, own = np.array(record["stiffness"]), np.array(record["isorod"])
        assert np.diag(own) == pytest.approx(np.diag(found), rel=1e-3)
        assert record["cells"] == 96


def test_what_is_not_given(capsys):
    """The section at the begin of the axis, of the first rod, at level 2 with degree 3."""
    for words in ("blade", "blade --rod 0 --u 0 --level 2 --degree 3"):
        assert main(words.split()) == 0
    first, second = (json.loads(line) | {"time": ""} for line in capsys.readouterr().out.splitlines())
    assert first == second


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("blade --rod 1", "rod: got 1, need 0"),
        ("flower", "flower: geometry alone, without laws"),
        ("sprig", "scene 'sprig' is not known"),
        ("blade --u 3", "axis parameter u: got 3"),
        ("blade --degree 9", "degree: got 9, need 1 to 4"),
        ("blade --level 0", "level: got 0, need 1 or more"),
    ],
)
def test_bad_words(words, said, capsys):
    assert main(words.split()) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert said in err


def test_laws_with_fibres_are_refused():
    muscle = isorod.Muscle(E=1.0, nu=0.4, sigma_max=1.0)
    with pytest.raises(InputError, match="isotropic laws only"):
        solve(body(isorod.circle(8), material=muscle), 0.0)
