"""Frames of thin bars, which random scenes of slender rods are held against, beside closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from comparisons.stability.frame import Bar, Frame

EVERY = np.eye(3)
TURNS = [Rotation.identity(), Rotation.from_rotvec([0.4, -1.1, 0.8])]
BAR = Bar(EA=900.0, GA=240.0, EI=(3.0, 5.0), GJ=2.0, mass=0.7, polar=0.01)
LENGTH, FORCE = 4.0, np.array([2e-3, -1e-3, 3e-3])


def straight(turn, bar=BAR, cells=4):
    """A bar along z, x across, and its nodes; the first is clamped; all is turned."""
    frame = Frame()
    nodes = frame.line(turn.apply(np.outer(np.linspace(0.0, LENGTH, cells + 1), [0, 0, 1])), bar, turn.apply([1, 0, 0]))
    for k in range(3):
        frame.hold(nodes[0], EVERY[k])
        frame.hold(nodes[0], EVERY[k], turn=True)
    return frame, nodes


@pytest.mark.parametrize("turn", TURNS)
def test_a_cantilever_is_timoshenkos_to_rounding(turn):
    """Timoshenko, Strength of Materials I, art. 39: tip deflections with shear; twist and stretch; reactions."""
    frame, nodes = straight(turn)
    moment = np.array([1e-3, 2e-3, -4e-3])
    frame.pull(nodes[-1], turn.apply(FORCE))
    frame.pull(nodes[-1], turn.apply(moment), turn=True)
    frame.solve()
    bend = np.array([LENGTH**3 / 3 / BAR.EI[1] + LENGTH / BAR.GA, LENGTH**3 / 3 / BAR.EI[0] + LENGTH / BAR.GA])
    moved = bend * FORCE[:2] + 0.5 * LENGTH**2 * np.array([moment[1] / BAR.EI[1], -moment[0] / BAR.EI[0]])
    turned = [
        -0.5 * LENGTH**2 * FORCE[1] / BAR.EI[0] + LENGTH * moment[0] / BAR.EI[0],
        0.5 * LENGTH**2 * FORCE[0] / BAR.EI[1] + LENGTH * moment[1] / BAR.EI[1],
        LENGTH * moment[2] / BAR.GJ,
    ]
    expected = np.r_[turn.apply([*moved, LENGTH * FORCE[2] / BAR.EA]), turn.apply(turned)]
    assert frame.moved[nodes[-1]] == pytest.approx(expected, rel=1e-8)
    assert frame.held[0::2] == pytest.approx(-turn.apply(FORCE), rel=1e-7)
    assert frame.held[1::2] == pytest.approx(-turn.apply(moment + np.cross([0, 0, LENGTH], FORCE)), rel=1e-7)
    assert frame.tensions == pytest.approx(np.full(4, FORCE[2]), rel=1e-7)


def arc(angle, cells):
    """A bar along a circle of radius 2 in the xz plane from (2, 0, 0), y across."""
    frame, at = Frame(), np.linspace(0.0, angle, cells + 1)
    nodes = frame.line(2.0 * np.column_stack([np.cos(at), 0.0 * at, np.sin(at)]), BAR, np.array([0.0, 1.0, 0.0]))
    return frame, nodes


def test_a_quarter_arc_is_castiglianos():
    """Roark's formulas, table of curved beams: energies of tension, shear, bending and twist of a clamped quarter."""
    errors = []
    for cells in (40, 80):
        frame, nodes = arc(0.5 * np.pi, cells)
        for k in range(3):
            frame.hold(nodes[0], EVERY[k])
            frame.hold(nodes[0], EVERY[k], turn=True)
        # The end points along -x; the force along x, across y.
        frame.pull(nodes[-1], np.array([1e-3, 1e-3, 0.0]))
        frame.solve()
        quarter, other = 0.25 * np.pi, 0.75 * np.pi - 2.0
        # The normal is y: bending in the plane is about the section's x.
        along = other * 8.0 / BAR.EI[0] + quarter * (2.0 / BAR.EA + 2.0 / BAR.GA)
        across = quarter * 8.0 / BAR.EI[1] + other * 8.0 / BAR.GJ + np.pi / BAR.GA
        errors.append(frame.moved[nodes[-1], :2] / (1e-3 * np.array([along, across])) - 1.0)
    assert np.abs(errors[1]).max() < 2e-4
    # Chords instead of the arc: of second order.
    assert errors[0] / errors[1] == pytest.approx([4.0, 4.0], rel=0.02)


def test_a_ring_that_is_pinched_shortens_as_it_should():
    """Timoshenko, Strength of Materials II, art. 15, with tension and shear, of a quarter held by its symmetry."""
    frame, nodes = arc(0.5 * np.pi, 160)
    frame.hold(nodes[0], EVERY[1])
    for node, across in ((nodes[0], EVERY[2]), (nodes[-1], EVERY[0])):
        frame.hold(node, across)
        frame.hold(node, EVERY[1], turn=True)
    for k in (0, 2):
        frame.hold(nodes[0], EVERY[k], turn=True)
    frame.pull(nodes[-1], np.array([0.0, 0.0, -0.5e-3]))
    frame.solve()
    shorter = 8.0 / BAR.EI[0] * (0.25 * np.pi - 2.0 / np.pi) + 0.5 * np.pi * (1.0 / BAR.EA + 1.0 / BAR.GA)
    assert frame.moved[nodes[-1], 2] == pytest.approx(-0.5e-3 * shorter, rel=2e-4)
    # Half the force is a pressure where it is not pinched; where it is there is none.
    assert frame.tensions[0] == pytest.approx(-0.5e-3, rel=1e-4)
    assert abs(frame.tensions[-1]) < 1e-2 * 0.5e-3


@pytest.mark.parametrize("turn", TURNS)
def test_frequencies_are_those_of_a_clamped_bar(turn):
    """Bending in two planes, stretching and twisting of a bar without shear (Blevins 1979, tables 8-1, 8-16, 8-19)."""
    thin = Bar(EA=20.0, GA=1e7, EI=(3.0, 5.0), GJ=2e-3, mass=0.7, polar=1e-4)
    frame, _ = straight(turn, thin, 60)
    bends = [brentq(lambda x: np.cos(x) * np.cosh(x) + 1.0, *two) ** 2 for two in ((1, 3), (4, 5))]
    found = [root * np.sqrt(stiff / (0.7 * LENGTH**4)) for root in bends for stiff in thin.EI]
    found += [0.5 * np.pi / LENGTH * np.sqrt(thin.EA / 0.7), 0.5 * np.pi / LENGTH * np.sqrt(thin.GJ / 1e-4)]
    assert frame.frequencies(6) == pytest.approx(np.sort(found) / (2.0 * np.pi), rel=2e-4)


@pytest.mark.parametrize("turn", TURNS)
def test_load_factors_are_eulers_with_shear(turn):
    """A clamped column: ``P / (1 + P/GA)`` of Euler's ``P`` (Engesser; Timoshenko & Gere 1961, art. 2.17)."""
    # What tension adds is that of a bar without shear: off by a fifth of the square of P/GA.
    bar = replace(BAR, GA=1000.0)
    frame, nodes = straight(turn, bar, 40)
    frame.pull(nodes[-1], turn.apply([0.0, 0.0, -0.1]))
    euler = np.array([stiff * (n * np.pi / 2.0 / LENGTH) ** 2 for n in (1, 3) for stiff in BAR.EI])
    euler /= 1.0 + euler / bar.GA
    assert frame.solve().factors(4) == pytest.approx(10.0 * euler, rel=1e-4)
    # Pressed, it vibrates more slowly: in the first mode nearly as (1 - load / Euler's)^(1/2) (Blevins, section 8.4).
    with_load = frame.frequencies(2, loaded=True) / frame.frequencies(2)
    assert with_load == pytest.approx(np.sqrt(1.0 - 0.1 / euler[:2]), rel=1e-2)


def test_springs_and_supports_that_move():
    """A tip on a spring; a tip that is moved, whose force is that of the deflection."""
    bend = LENGTH**3 / 3.0 / BAR.EI[1] + LENGTH / BAR.GA
    frame, nodes = straight(TURNS[0])
    frame.springs.append((6 * nodes[-1], 0.25))
    frame.pull(nodes[-1], np.array([1e-3, 0.0, 0.0]))
    assert frame.solve().moved[nodes[-1], 0] == pytest.approx(1e-3 / (0.25 + 1.0 / bend), rel=1e-8)
    frame, nodes = straight(TURNS[0])
    at = frame.hold(nodes[-1], EVERY[0], 2e-3)
    frame.solve()
    assert frame.moved[nodes[-1], 0] == pytest.approx(2e-3, rel=1e-9)
    assert frame.held[at] == pytest.approx(2e-3 / bend, rel=1e-7)
