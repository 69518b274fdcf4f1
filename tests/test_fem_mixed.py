"""Taylor-Hood elements in dolfinx: exact where a solution is known, and beside the mixed formulation of rods."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from isorod import options

options.initialize([])

from comparisons.fem import mixed, mixed_modes  # noqa: E402
from comparisons.fem.domain import Domain  # noqa: E402
from comparisons.fem.statics import Held  # noqa: E402
from comparisons.stability import incompressible  # noqa: E402
from isorod.geometry.center_line import straight  # noqa: E402
from isorod.geometry.section import circle  # noqa: E402
from isorod.material.mooney_rivlin import MooneyRivlin  # noqa: E402
from meshes.bricks import bricks  # noqa: E402
from meshes.template import o_grid  # noqa: E402

LAWS = {
    "nearly": incompressible.law(0.499999),
    "neo-Hookean": incompressible.law(0.5),
    "Mooney-Rivlin": MooneyRivlin(0.3, 0.2, np.inf),
}


@pytest.mark.parametrize("name", LAWS)
def test_uniform_stretch_is_exact(name):
    """A bar of which only the two ends and one component of the side move as they must; the rest follows."""
    stretch = 1.2
    shrink = stretch**-0.5 - 1.0
    mesh = bricks(straight(2.0).sweep(circle(8)), o_grid(8, 1, 2), 2)
    held = [
        mixed.Guided("lateral", 1, lambda x: shrink * x[1]),
        mixed.Guided("start", 0, lambda x: shrink * x[0]),
        mixed.Guided("start", 2, lambda x: 0.0 * x[2]),
        mixed.Guided("end", 2, lambda x: (stretch - 1.0) * x[2]),
    ]
    found = mixed.solve(Domain.distribute(mesh), LAWS[name], held, steps=2)
    # A guided face reports force times displacement.
    modulus = 0.6 + 0.4 / stretch if name == "Mooney-Rivlin" else 1.0
    force = modulus * (stretch - stretch**-2) * mesh.volume() / 2.0
    assert found.reactions[3, 2] == pytest.approx(force * (stretch - 1.0) * 2.0, rel=1e-5)
    assert np.abs(found.reactions[:3]).max() < 1e-5


def test_dead_load_and_reaction_balance():
    domain = Domain.distribute(bricks(straight(4.0).sweep(circle(8)), o_grid(8, 1, 2), 4))
    found = mixed.solve(domain, incompressible.law(0.5), [Held("start")], {"end": (0.0, 0.05, 0.02)})
    assert found.reactions[0] == pytest.approx([0.0, -0.05, -0.02], abs=1e-9)
    assert found.deflections["end"][1] > 0.05


@pytest.mark.parametrize("nu", [0.3, 0.499999])
def test_rods_and_bricks_agree_on_the_pinched_section(nu):
    coarse = incompressible.reference(incompressible.PINCHED, nu, 8, 1, 12)
    ours, _ = incompressible.pinched(nu, "mixed", order=3)
    assert ours == pytest.approx(coarse, rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("case", incompressible.MESHES)
def test_stored_references_are_those_of_the_meshes_named(case):
    found = incompressible.reference(case, incompressible.RATIOS[2], *incompressible.MESHES[case])
    assert found == pytest.approx(incompressible.REFERENCE[case][2], rel=1e-6)


def test_modes_of_a_free_incompressible_cylinder():
    """Six bricks along; torsion, whose frequencies are exact, is the third mode of both."""
    domain = Domain.distribute(bricks(mixed_modes.cylinder(), o_grid(8, 1, 2), 6))
    theirs = mixed_modes.modes(domain, incompressible.law(0.5), 1.0, count=3).frequencies[6:]
    ours = mixed_modes.CASES["cylinder"].ours(0.5).frequencies[6:9]
    assert ours == pytest.approx(theirs, rel=5e-3)
    assert [ours[2], theirs[2]] == pytest.approx([1.0 / 12.0] * 2, rel=1e-4)


def test_a_table_of_modes_has_the_cases_and_ratios_asked_for(monkeypatch, capsys):
    asked = []

    def row(case, nu):
        asked.append((case, nu))
        return mixed_modes.Row(nu, 1e-3, 2e-3, (100, 2000), (0.5, 2.0), None)

    monkeypatch.setattr(mixed_modes, "row", row)
    assert mixed_modes.main(["--case", "cylinder", "--nu", "0.45", "--nu", "0.5"]) == 0
    assert asked == [(mixed_modes.CASES["cylinder"], nu) for nu in (0.45, 0.5)]
    said = capsys.readouterr().out.splitlines()
    assert said[0] == f"{mixed_modes.CASES['cylinder'].title}: {mixed_modes.MODES} frequencies"
    assert [line.split()[:2] for line in said[2:]] == [["0.45", "0.100"], ["0.5", "0.100"]]
    asked.clear()
    assert mixed_modes.main([]) == 0
    assert asked == [(case, nu) for case in mixed_modes.CASES.values() for nu in mixed_modes.RATIOS]


@pytest.mark.slow
@pytest.mark.parametrize("case", mixed_modes.CASES)
@pytest.mark.parametrize("nu", [0.49999, 0.5])
def test_modes_by_default_are_within_half_a_percent(case, nu):
    found = mixed_modes.row(mixed_modes.CASES[case], nu)
    assert found.error < 5e-3
