"""The NURBS axis: its functions against the Cox-de Boor recursion, and transfers that leave the curve as it is."""

import numpy as np
import pytest
from disks import derivative
from hypothesis import given
from hypothesis import strategies as st
from refused import refused

from isorod import Axis


def cox_de_boor(knots, p, j, u):
    if p == 0:
        last = knots[j + 1] == knots[-1] and u == knots[-1]
        return float(knots[j] < knots[j + 1] and (knots[j] <= u < knots[j + 1] or last))
    value = 0.0
    if knots[j + p] > knots[j]:
        value += (u - knots[j]) / (knots[j + p] - knots[j]) * cox_de_boor(knots, p - 1, j, u)
    if knots[j + p + 1] > knots[j + 1]:
        value += (knots[j + p + 1] - u) / (knots[j + p + 1] - knots[j + 1]) * cox_de_boor(knots, p - 1, j + 1, u)
    return value


@st.composite
def axes(draw, max_degree=6):
    p = draw(st.integers(1, max_degree))
    lengths = draw(st.lists(st.floats(0.2, 3), min_size=1, max_size=5))
    breaks = draw(st.floats(-5, 5)) + np.concatenate([[0.0], np.cumsum(lengths)])
    inner = [draw(st.integers(1, p)) for _ in lengths[1:]]
    knots = np.repeat(breaks, [p + 1, *inner, p + 1])
    count = knots.size - p - 1
    weights = draw(st.lists(st.floats(0.2, 3), min_size=count, max_size=count))
    return Axis(p, knots, np.array(weights))


def parameters(axis, each=7):
    """Points inside every element, and all knots."""
    inside = np.linspace(0, 1, each + 2)[1:-1]
    spans = axis.breaks[:-1, None] + np.diff(axis.breaks)[:, None] * inside
    return np.concatenate([spans.ravel(), axis.breaks])


def dense(axis, u):
    """All functions and slopes, shape ``(t, m)``."""
    first, values, slopes = axis.local(u)
    full = np.zeros((2, len(u), axis.count))
    columns = first[:, None] + np.arange(axis.degree + 1)
    full[0][np.arange(len(u))[:, None], columns] = values
    full[1][np.arange(len(u))[:, None], columns] = slopes
    return full


def curve_points(axis, seed=1):
    return np.random.default_rng(seed).normal(size=(axis.count, 3))


def assert_same_curve(axis, finer, seed=1):
    points = curve_points(axis, seed)
    moved = axis.transfer(finer, points)
    u = np.concatenate([parameters(axis), parameters(finer, 2)])
    for old, new in zip(dense(axis, u) @ points, dense(finer, u) @ moved, strict=True):
        scale = max(1.0, np.abs(old).max())
        assert np.abs(old - new).max() < 1e-12 * scale


def multiplicities(axis):
    return dict(zip(*(x.tolist() for x in np.unique(axis.knots, return_counts=True)), strict=True))


@given(axis=axes())
def test_functions_are_those_of_the_recursion_with_weights(axis):
    u = parameters(axis, 3)
    basis = np.array([[cox_de_boor(axis.knots, axis.degree, j, x) for j in range(axis.count)] for x in u])
    expected = basis * axis.weights / (basis @ axis.weights)[:, None]
    assert np.abs(dense(axis, u)[0] - expected).max() < 1e-13


@given(axis=axes())
def test_slopes_are_derivatives_of_the_values(axis):
    centre = axis.breaks[:-1, None] + np.diff(axis.breaks)[:, None] * np.array([0.3, 0.5, 0.7])
    h = 0.005 * np.diff(axis.breaks).min()
    difference = derivative(lambda u: dense(axis, u)[0], centre.ravel(), 1.0, h)
    slopes = dense(axis, centre.ravel())[1]
    assert np.abs(difference - slopes).max() < 1e-10 * np.abs(slopes).max()


@given(axis=axes())
def test_at_a_knot_the_element_above_is_meant_and_at_the_last_the_one_below(axis):
    first, _, _ = axis.local(axis.breaks)
    assert first[:-1].tolist() == axis.first_function.tolist()
    assert first[-1] == axis.first_function[-1]


@given(axis=axes(), where=st.floats(0.01, 0.99), data=st.data())
def test_knot_insertion_leaves_the_curve(axis, where, data):
    u = float(axis.knots[0] + where * (axis.knots[-1] - axis.knots[0]))
    if np.abs(axis.breaks - u).min() < 0.01:
        return
    times = data.draw(st.integers(1, axis.degree))
    finer = axis.insert(u, times)
    assert multiplicities(finer) == multiplicities(axis) | {u: times}
    assert_same_curve(axis, finer)


@pytest.mark.parametrize("times", [1, 2])
def test_an_interior_knot_can_be_inserted_again_up_to_the_degree(times):
    axis = Axis(3, [0, 0, 0, 0, 1, 2, 2, 2, 2], [1, 0.5, 2, 1, 3])
    finer = axis.insert(1.0, times)
    assert multiplicities(finer)[1.0] == 1 + times
    assert_same_curve(axis, finer)


@given(axis=axes(max_degree=3), parts=st.integers(1, 4), raised=st.integers(0, 3), data=st.data())
def test_refinement_leaves_the_curve_and_makes_the_knots_asked_for(axis, parts, raised, data):
    degree = axis.degree + raised
    continuity = data.draw(st.integers(0, degree - 1))
    finer = axis.refine(parts, degree, continuity)
    assert finer.degree == degree
    assert finer.elements == parts * axis.elements
    assert set(axis.breaks) <= set(finer.breaks)
    for u, times in multiplicities(finer).items():
        if u in (axis.knots[0], axis.knots[-1]):
            assert times == degree + 1
        elif u in axis.breaks:
            assert degree - times == min(continuity, axis.degree - multiplicities(axis)[u])
        else:
            assert degree - times == continuity
    assert_same_curve(axis, finer)


def test_elevating_a_circular_arc_leaves_it_a_circle():
    axis = Axis(2, [0, 0, 0, 1, 1, 1], [1, np.sqrt(0.5), 1])
    points = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    for degree in (3, 4, 5, 6):
        finer = axis.refine(3, degree)
        curve = dense(finer, np.linspace(0, 1, 50))[0] @ axis.transfer(finer, points)
        assert np.abs(np.hypot(*curve.T) - 1).max() < 1e-14


test_refuses_what_is_no_axis = refused(
    (0, [0, 1], [1], "degree: got 0"),
    (7, [0] * 8 + [1] * 8, [1] * 8, "degree: got 7"),
    (1.5, [0, 0, 1, 1], [1, 1], "degree: got 1.5"),
    (np.nan, [0, 0, 1, 1], [1, 1], "degree: got nan"),
    (2, [0, 0, 0, 2, 1, 3, 3, 3], [1] * 5, r"knot 4 is 1 after 2; knots must not decrease"),
    (2, [0, 0, 0, np.nan, 1, 1, 1], [1] * 4, "knot 3 is nan"),
    (2, [0, 0, 0, 1, 1, np.inf], [1] * 3, "knot 5 is inf"),
    (2, [0, 0, 0, 1, 1, 1], [1, np.nan, 1], "weight 1 is nan"),
    (2, [0, 0, 0, 1, 1, 1], [1, 0, 1], "weight 1 is 0; weights must be positive"),
    (2, [0, 0, 0, 1, 1, 1], [1, 1, -2], "weight 2 is -2"),
    (2, [0, 0, 0, 1, 1, 1], [1, 1], "need 3 weights, got 2"),
    (2, [0, 0, 1, 1, 1], [1, 1], "must each stand 3 times"),
    (2, [0, 0, 0, 0, 1, 1, 1], [1] * 4, "must each stand 3 times"),
    (2, [1, 1, 1, 1, 1, 1], [1] * 3, "must each stand 3 times"),
    (2, [0, 0, 0, 1, 1, 1, 2, 2, 2], [1] * 6, "interior knot 1 stands 3 times; degree 2 allows 2"),
    (1, [], [], "weights|knots|knot"),
    by=Axis,
)


LINE, ARC = Axis(1, [0, 0, 1, 1], [1, 1]), Axis(2, [0, 0, 0, 1, 1, 1], [1, 1, 1])
TWO = Axis(2, [0, 0, 0, 1, 2, 2, 2], [1, 1, 1, 1])
test_refuses_what_cannot_be_done_with_an_axis = refused(
    (lambda: ARC.refine(degree=1), "degree: got 1, need an integer from 2 to 6"),
    (lambda: ARC.refine(degree=7), "degree: got 7"),
    (lambda: ARC.refine(degree=2.5), "degree: got 2.5"),
    (lambda: ARC.refine(continuity=2), "continuity: got 2, need an integer from 0 to 1"),
    (lambda: ARC.refine(continuity=-1), "continuity: got -1"),
    (lambda: ARC.refine(degree=3, continuity=3), "continuity: got 3, need an integer from 0 to 2"),
    (lambda: ARC.refine(parts=0), "parts of an element: got 0"),
    (lambda: ARC.refine(parts=1.5), "parts of an element: got 1.5"),
    *((lambda u=u: TWO.insert(u, 1), "not inside") for u in (0.0, 2.0, np.nan)),
    (lambda: TWO.insert(0.5, 3), "1 .. 2"),
    (lambda: TWO.insert(0.5, 0), "1 .. 2"),
    (lambda: TWO.insert(1.0, 2), "stands 1 times"),
    *((lambda u=u: LINE.local([0.5, u]), "outside") for u in (-0.1, 1.1, np.nan)),
)
