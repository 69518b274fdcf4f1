"""Mean supports, springs, forces on lines and at places, and histories in input files, and as CalculiX solves them."""

import re
from math import cos, sin
from pathlib import Path

import numpy as np
import pytest
from calculix import answers, calculix, nodes
from scipy.integrate import trapezoid
from test_deck import blocks, folder, rows

from isorod import files
from meshes.__main__ import main

__all__ = ["folder"]

BAR = """[rod.beam]
curve = {straight = 4.0}
section = {circle = 0.5}
law = {StVenantKirchhoff = {E = 100.0, nu = 0.3}}
density = 2.0
"""
ARC = BAR.replace("straight = 4.0", "arc = {radius = 4.0, angle = 90}")
LAYERS = BAR.replace("density = 2.0", "rings = [0.0, 0.7, 1.0]").replace(
    "law = {StVenantKirchhoff = {E = 100.0, nu = 0.3}}",
    "law = [{StVenantKirchhoff = {E = 10.0, nu = 0.3}}, {StVenantKirchhoff = {E = 100.0, nu = 0.3}}]",
)
FOOT = '[support.foot]\nend = "start"\n'
STATICS = "[analysis.statics]\n"
TIP = '[measure.tip]\ndisplacement = "beam"\n'
FORCES = '[measure.foot]\nreaction = "foot"\n[measure.bent]\nmoment = "foot"\n'


# Measured: 3.2e-3 and 2.5e-3 of a bearing; 5e-4 and 8e-4 of an end that moves; 3e-4; 1e-4 of springs; 1.6e-3 of modes;
# 1.8e-3 of buckling; 1.3e-3 of a force per length; 2.2e-3 of one at a place; 1.7e-3 of layers; 8e-4 of histories.
@calculix
@pytest.mark.parametrize(
    "text",
    [
        pytest.param(
            BAR + FOOT + "[support.ring]\nbearing = 0.5\n"
            '[load.end]\nend = "end"\nforce = [0.3, 0.1, 0.0]\n'
            + STATICS + TIP + '[measure.ring]\nreaction = "ring"\n',
            id="bearing",
        ),
        pytest.param(
            BAR + FOOT + '[support.hand]\nend = "end"\nmean = "fixed"\ndisplacement = [0.4, 0.0, 0.1]\n'
            + STATICS + '[measure.hand]\nreaction = "hand"\n[measure.bent]\nmoment = "foot"\n',
            id="fixed",
        ),
        pytest.param(
            BAR + '[support.foot]\nend = "start"\nmean = "fork"\n[support.ring]\nbearing = 0.0\n'
            "[support.hand]\nbearing = 1.0\n[load.side]\nsection = 0.5\nforce = [0.2, 0.0, 0.0]\n"
            + STATICS + TIP + "u = 0.5\n",
            id="two at one section",
        ),
        pytest.param(
            BAR + FOOT + "[support.spring]\nspring = 0.75\nstiffness = [2.0, 0.0, 1.0]\nrotational = [0.0, 3.0, 0.0]\n"
            '[load.end]\nend = "end"\nforce = [0.3, 0.1, 0.5]\n' + STATICS + TIP + '[measure.k]\nreaction = "spring"\n',
            id="springs",
        ),
        pytest.param(
            BAR + '[support.foot]\nend = "start"\nmean = "hinge"\naxis = [1, 0, 0]\n[support.hand]\nbearing = 1.0\n'
            "[support.spring]\nspring = 0.5\nstiffness = [2.0, 3.0, 1.0]\n[analysis.modal]\nmodes = 4\n",
            id="modes",
        ),
        pytest.param(
            BAR.replace("4.0", "20.0", 1) + '[support.foot]\nend = "start"\nmean = "fork"\n'
            '[support.hand]\nend = "end"\nmean = "pin"\ncomponents = "xy"\n[load.push]\nend = "end"\n'
            "force = [0.0, 0.0, -1.0]\n[analysis.buckling]\nmodes = 2\nlinear_at = 0.0\n",
            id="buckling",
            marks=pytest.mark.slow,
        ),
        pytest.param(ARC + FOOT + "[load.q]\nper_length = [0.0, 0.02, 0.01]\n" + STATICS + TIP + FORCES, id="line"),
        pytest.param(
            BAR + FOOT + "[load.p]\nat = 0.8\nangle = 80\nforce = [0.05, 0.0, 0.2]\n" + STATICS + TIP + FORCES,
            id="place",
            marks=pytest.mark.filterwarnings("ignore:.*a point force has no limit"),
        ),
        pytest.param(
            LAYERS + '[support.foot]\nend = "start"\nmean = "fixed"\n[support.spring]\nspring = "end"\n'
            "stiffness = [1.0, 0.0, 0.0]\n[load.q]\nper_length = [0.05, 0.02, 0.0]\n" + STATICS + TIP + FORCES
            + '[measure.k]\nreaction = "spring"\n',
            id="layers",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            BAR + FOOT + '[support.hand]\nend = "end"\nmean = "pin"\ndisplacement = [0.0, 0.2, 0.0]\n'
            "history = [[0, 0], [2, 1]]\n[load.a]\nsection = 0.5\nforce = [0.5, 0.0, 0.0]\n"
            "history = [[0, 0], [1, 1], [2, 0.5]]\n[load.b]\nsection = 0.75\nforce = [0.0, 0.0, 1.0]\n"
            "history = [[0, 0], [1, 1], [2, 0]]\n[analysis.statics]\nend_time = 2.0\n" + TIP
            + 'u = 0.5\n[measure.hand]\nreaction = "hand"\n',
            id="history",
        ),
    ],
)  # fmt: skip
def test_calculix_finds_what_isorod_finds(text):
    Path("my.toml").write_text(text)
    for what, (theirs, ours) in answers("my.toml", "job").items():
        assert np.linalg.norm(theirs - ours) < 4e-3 * np.linalg.norm(ours), what


def written(text, *words):
    Path("my.toml").write_text(text)
    assert main(["my.toml", "my.inp", *words]) == 0
    return blocks(Path("my.inp").read_text())


def equations(found):
    """Terms of each equation: nodes, components and coefficients."""
    result = []
    for count, *lines in rows(found, "EQUATION"):
        values = np.array(",".join(lines).split(","), dtype=float).reshape(-1, 3)
        assert len(values) == int(count)
        result.append(values)
    return result


@pytest.mark.parametrize("element", ["C3D20R", "C3D8I"])
@pytest.mark.parametrize("text", [ARC, LAYERS])
def test_reference_nodes_move_and_turn_as_the_section_does(text, element):
    """Of a rigid motion, and of a stretch about the middle, which turns nothing and moves no middle."""
    more = '[support.foot]\nend = "start"\nmean = "fixed"\n[support.ring]\nbearing = 0.5\n'
    more += '[support.spring]\nspring = "end"\nstiffness = [1.0, 2.0, 3.0]\nrotational = [4.0, 0.0, 5.0]\n'
    found = written(text + more + STATICS, "--element", element)
    (size,), own = nodes("my").shape[:1], nodes("my")
    places = {head[len("NODE,NSET=") :]: body[0].split(",") for head, body in found if head.startswith("NODE,NSET=")}
    places = {name: (int(line[0]), np.array(line[1:], dtype=float)) for name, line in places.items() if name != "NALL"}
    assert sorted(number for number, _ in places.values()) == [*range(size + 1, size + 6)]
    way, turn = np.array([0.3, -0.2, 0.5]), np.array([0.7, 0.4, -0.6])
    moved = {k: way + np.cross(turn, x) for k, x in enumerate(own, 1)}
    # A bearing between axes has two components of its own, which are told.
    said = re.search(r"SUPPORT_RING_MEAN: its components are along \((.*)\); \((.*)\)", Path("my.inp").read_text())
    across = np.array([one.split(", ") for one in said.groups()], dtype=float) if said else np.eye(3)
    for name, (number, x) in places.items():
        moved[number] = turn if name.endswith("ROTATION") else way + np.cross(turn, x)
        if name == "SUPPORT_RING_MEAN":
            moved[number] = np.append(across @ moved[number], 0.0)
    terms = equations(found)
    assert len(terms) == 6 + 2 + 5
    first = {(int(one[0, 0]), int(one[0, 1])) for one in terms}
    assert len(first) == len(terms)
    for one in terms:
        assert not first & {(int(node), int(component)) for node, component, _ in one[1:]}
        values = [moved[int(node)][int(component) - 1] for node, component, _ in one]
        # Directions are told to nine digits.
        assert abs(one[:, 2] @ values) < 1e-7 * np.abs(one[:, 2]).max()
    springs = [float(body[1]) for head, body in found if head.startswith("SPRING,")]
    assert springs == [1.0, 2.0, 3.0, 4.0, 5.0]


@pytest.mark.parametrize("closed", [False, True])
def test_forces_per_length_are_as_much_as_the_line_is_long(closed):
    """A curved line, whose outside is longer than its inside: the load's middle is that of the line."""
    ring = [[4.0 * cos(t), 3.0 * sin(t), 0.0] for t in np.linspace(0.0, 2.0 * np.pi, 33)[:-1].tolist()]
    text = ARC.replace(
        "arc = {radius = 4.0, angle = 90}", f"polyline = {{points = {ring}, closed = true, tolerance = 0}}"
    )
    text = text if closed else ARC
    support = FOOT if not closed else '[support.foot]\nsection = 0.0\nmean = "fixed"\n'
    found = written(text + support + "[load.q]\nper_length = [0.0, 0.02, 0.01]\n" + STATICS)
    forces = np.zeros((len(nodes("my")), 3))
    for node, component, value in (line.split(",") for line in rows(found, "CLOAD")[0]):
        forces[int(node) - 1, int(component) - 1] += float(value)
    rod = files.find("my.toml").rods()[0]
    u = np.linspace(*rod.axis.breaks[[0, -1]], 4001)
    line, jacobian = rod.grid([[0.0, 0.0]], u)
    speed = np.linalg.norm(jacobian[:, 0, :, 2], axis=1)
    length = trapezoid(speed, u)
    assert forces.sum(axis=0) == pytest.approx(length * np.array([0.0, 0.02, 0.01]), rel=1e-5, abs=1e-12)
    middle = nodes("my").T @ forces[:, 2] / forces[:, 2].sum()
    assert middle == pytest.approx(trapezoid(line[:, 0] * speed[:, None], u, axis=0) / length, abs=2e-3)


def test_a_force_at_a_place_has_the_moment_of_that_place():
    for surface, radius in (("outer", 0.5), ("inner", 0.3)):
        text = BAR.replace("density = 2.0", "rings = [0.6, 1.0]") + FOOT
        with pytest.warns(UserWarning, match="no limit"):
            found = written(
                text + f'[load.p]\nat = 0.8\nangle = 70\nforce = [1.0, 2.0, 3.0]\nsurface = "{surface}"\n' + STATICS
            )
        places, forces = nodes("my"), np.zeros((len(nodes("my")), 3))
        for node, component, value in (line.split(",") for line in rows(found, "CLOAD")[0]):
            forces[int(node) - 1, int(component) - 1] += float(value)
        angle = np.radians(70.0)
        place = np.array([radius * np.cos(angle), radius * np.sin(angle), 3.2])
        own = places.T @ forces
        # Of the section's own frame, which may be turned.
        assert own[2] == pytest.approx(3.2 * np.array([1.0, 2.0, 3.0]), rel=1e-9)
        assert np.linalg.norm(own[:2, 2]) == pytest.approx(3.0 * radius, rel=2e-3)
        assert own[:2] == pytest.approx(np.outer(place[:2], (1.0, 2.0, 3.0)), abs=5e-3 * radius * 4)


def test_a_force_of_a_history_stands_in_all_steps():
    more = "[load.a]\nsection = 0.5\nforce = [0.5, 0.0, 0.0]\nhistory = [[0, 0], [1, 1], [2, 0]]\n"
    found = written(BAR + FOOT + more + "[analysis.statics]\nend_time = 2.0\n")
    full, none = (
        {tuple(line.split(",")[:2]): float(line.split(",")[2]) for line in one} for one in rows(found, "CLOAD")
    )
    assert full.keys() == none.keys() and sum(full.values()) == pytest.approx(0.5)
    assert not any(none.values())


def test_means_of_what_is_tied_are_refused(capsys):
    high = BAR.replace("beam", "high").replace("straight = 4.0", "straight = {start = [0, 0, 4], end = [0, 0, 8]}")
    tie = '[tie.weld]\nslave = "high.start"\nmaster = "beam.end"\n[support.neck]\nrod = "high"\nbearing = 0.0\n'
    Path("my.toml").write_text(BAR + high + FOOT + 'rod = "beam"\n' + tie + STATICS)
    assert main(["my.toml", "my.inp"]) == 2
    err = capsys.readouterr().err
    assert "support neck: a mean motion of what is tied" in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (
            '[support.again]\nend = "start"\nmean = "pin"\n' + STATICS,
            "supports of mean motions hold what another support holds",
        ),
        (
            '[support.hand]\nend = "end"\nrotation = [0, 0, 9]\nhistory = [[0, 0], [1, 1]]\n[analysis.statics]\n'
            "end_time = 1.0\n",
            "end_time: temperatures and supports that turn over time are not written",
        ),
        (
            '[load.a]\nend = "end"\nforce = [0, 0, 1]\nhistory = [[0, 0], [1, 1]]\n[analysis.modal]\n',
            "load a: history",
        ),
        (
            '[support.hand]\nend = "end"\nmean = "pin"\ndisplacement = [0, 0, -1]\n[analysis.buckling]\n',
            "buckling under supports that move",
        ),
    ],
)
def test_what_is_not_written_is_one_line(more, said, capsys):
    Path("my.toml").write_text(BAR + FOOT + more)
    assert main(["my.toml", "my.inp"]) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1 and not Path("my.inp").exists()
