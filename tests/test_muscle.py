"""The muscle law: fibre curves of the paper, derivatives, invariance, and bars whose force has a closed form."""

import numpy as np
import pytest
from conftest import straight
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import brentq

from isorod import statics
from isorod.errors import InputError
from isorod.geometry.center_line import helix
from isorod.geometry.section import circle
from isorod.material import LinearElastic, NeoHookean
from isorod.material.muscle import Muscle
from isorod.model import Body, Model, Support
from isorod.output.stress import cauchy
from isorod.space import Space

EYE = np.eye(3)
WEIGHTS = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
# The paper's constants.
PAPER = {"E": 30.0, "nu": 0.49, "sigma_max": 30.0, "m1": 35.0, "m2": 0.5}
MATRIX = NeoHookean(30.0, 0.49)


def active(stretch):
    """Eq. 18 at full activation, with no force beyond half the length."""
    return np.where(np.abs(stretch - 1) < 0.5, 30.0 * (1 - 4 * (1 - stretch) ** 2), 0.0)


def passive(stretch):
    """Eq. 19."""
    return np.where(stretch > 1, 35.0 * stretch * (np.exp(0.5 * (stretch**2 - 1)) - 1), 0.0)


def directions(count, seed=1):
    return np.random.default_rng(seed).normal(size=(count, 3))


def stretches(F, fibres):
    unit = fibres / np.linalg.norm(fibres, axis=1)[:, None]
    return np.linalg.norm(np.einsum("mab,mb->ma", F, unit), axis=1)


def states(count=800, size=0.45):
    """Deformations and fibres of all ranges of the law, none so close to a kink that differences step over it."""
    F = EYE + size * np.random.default_rng(0).uniform(-1, 1, (count, 3, 3))
    fibres = directions(count)
    stretch = stretches(F, fibres)
    good = (np.linalg.det(F) > 0.3) & (np.abs(stretch[:, None] - [0.5, 1.0, 1.5]).min(axis=1) > 0.01)
    return F[good], fibres[good]


def difference(f, F, a, A, h=1e-3):
    step = np.zeros((3, 3))
    step[a, A] = h
    return sum(w * (f(F + k * step) - f(F - k * step)) for k, w in enumerate(WEIGHTS, 1)) / h


def rotation(a, b, c):
    x, y, z = (
        np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]),
        np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]]),
        np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]]),
    )
    return x @ y @ z


def test_states_cover_all_ranges_of_the_law():
    stretch = stretches(*states())
    counts, _ = np.histogram(stretch, [0, 0.5, 1.0, 1.5, 3.0])
    assert (counts >= 3).all()


def fibre_part(law, stretch):
    """Fibre stress of a stretch along the fibre, the rest of F being anything."""
    F = np.diag([1.1, 0.9, 1.0]) + np.outer(np.arange(3), [0, 0.05, 0])
    F = np.repeat(F[None], stretch.size, axis=0)
    F[:, :, 2] = rotation(0.4, -0.3, 1.0)[:, 2] * stretch[:, None]
    extra = law.stress(F) - MATRIX.stress(F)
    assert np.abs(extra[:, :, :2]).max() < 1e-12
    along = F[:, :, 2] / stretch[:, None]
    tension = np.einsum("ma,ma->m", extra[:, :, 2], along)
    assert np.abs(extra[:, :, 2] - tension[:, None] * along).max() < 1e-11
    return tension


@pytest.mark.parametrize("activation", [0.0, 0.4, 1.0])
def test_fibre_stress_is_the_curves_of_the_paper(activation):
    stretch = np.linspace(0.2, 1.9, 171)
    law = Muscle(**PAPER, activation=activation, fibre=(0, 0, 2.0))
    assert fibre_part(law, stretch) == pytest.approx(activation * active(stretch) + passive(stretch), abs=1e-11)


def test_named_points_of_the_curves():
    """Largest active stress at rest length, three quarters a quarter away, none from half a length on.

    Passive from rest on.
    """
    law = Muscle(**PAPER, activation=1.0, fibre=(0, 0, 1))
    found = fibre_part(law, np.array([1.0, 0.75, 0.5, 0.3, 0.5 + 1e-9]))
    assert found == pytest.approx([30.0, 22.5, 0.0, 0.0, 30 * 4e-9], abs=1e-12)
    resting = Muscle(**PAPER, fibre=(0, 0, 1))
    assert fibre_part(resting, np.array([0.7, 1.0, 1.2])) == pytest.approx([0, 0, 42.0 * np.expm1(0.22)], abs=1e-12)
    # continuous at rest length, where the slope jumps to 2 m1 m2
    assert fibre_part(resting, np.array([1 + 1e-7])) == pytest.approx([35e-7], rel=1e-5)


@pytest.mark.parametrize("stretch", [0.3, 0.6, 0.99, 1.3, 1.7])
def test_energy_is_the_integral_of_the_fibre_stress(stretch):
    law = Muscle(**PAPER, activation=0.6, fibre=(0, 1, 0))
    F = np.diag([1.0, stretch, 1.0])[None]
    kinks = [x for x in (0.5, 1.5) if min(1, stretch) < x < max(1, stretch)]
    integral, _ = quad(lambda x: 0.6 * active(x) + passive(x), 1.0, stretch, points=kinks or None, epsabs=1e-12)
    assert law.energy(F) - MATRIX.energy(F) == pytest.approx([integral], rel=1e-11)


def test_without_an_exponent_there_is_no_passive_stress():
    F, fibres = states()
    law = Muscle(**(PAPER | {"m2": 0.0}), fibre=fibres)
    assert np.abs(law.energy(F) - MATRIX.energy(F)).max() < 1e-14
    assert np.abs(law.stress(F) - MATRIX.stress(F)).max() < 1e-14


def test_stress_is_the_derivative_of_the_energy():
    F, fibres = states()
    law = Muscle(**PAPER, activation=0.7, fibre=fibres)
    stress = law.stress(F)
    for a in range(3):
        for A in range(3):
            assert np.abs(difference(law.energy, F, a, A) - stress[:, a, A]).max() < 1e-9 * np.abs(stress).max()


def test_tangent_is_the_derivative_of_the_stress_and_has_major_symmetry():
    F, fibres = states()
    law = Muscle(**PAPER, activation=0.7, fibre=fibres)
    tangent = law.tangent(F)
    for b in range(3):
        for B in range(3):
            assert np.abs(difference(law.stress, F, b, B) - tangent[..., b, B]).max() < 1e-9 * np.abs(tangent).max()
    assert np.abs(tangent - tangent.transpose(0, 3, 4, 1, 2)).max() < 1e-14 * np.abs(tangent).max()


angles = st.floats(-np.pi, np.pi)


@given(a=angles, b=angles, c=angles)
def test_law_is_frame_indifferent_and_sees_no_turn_about_the_fibre(a, b, c):
    F, fibres = states(40)
    law, Q = Muscle(**PAPER, activation=0.7, fibre=fibres), rotation(a, b, c)
    scale = np.abs(law.stress(F)).max()
    assert np.abs(law.energy(Q @ F) - law.energy(F)).max() < 1e-12 * scale
    assert np.abs(law.stress(Q @ F) - Q @ law.stress(F)).max() < 1e-12 * scale
    about_z, turn = Muscle(**PAPER, activation=0.7, fibre=(0, 0, 1)), rotation(0, 0, c)
    assert np.abs(about_z.energy(F @ turn) - about_z.energy(F)).max() < 1e-12 * scale
    # the sense of the fibre does not matter, nor do material and fibre that are turned together
    assert np.abs(Muscle(**PAPER, activation=0.7, fibre=-fibres).stress(F) - law.stress(F)).max() < 1e-12 * scale
    turned = Muscle(**PAPER, activation=0.7, fibre=fibres @ Q)
    assert np.abs(turned.energy(F @ Q) - law.energy(F)).max() < 1e-12 * scale


def test_each_point_is_by_itself():
    F, fibres = states()
    law = Muscle(**PAPER, activation=0.7, fibre=fibres)
    stress, energy = law.stress(F), law.energy(F)
    for m in range(0, len(F), 7):
        alone = Muscle(**PAPER, activation=0.7, fibre=fibres[m])
        assert alone.energy(F[m][None])[0] == pytest.approx(energy[m], rel=1e-14)
        assert alone.stress(F[m][None])[0] == pytest.approx(stress[m], rel=1e-13, abs=1e-12)


def test_a_muscle_without_fibres_is_its_matrix():
    F, _ = states()
    slack = Muscle(30.0, 0.49, fibre=(0, 0, 1.0))
    assert slack.stress(F) == pytest.approx(MATRIX.stress(F), rel=1e-13, abs=1e-12)


@pytest.mark.parametrize("F", [np.diag([1, 1, 0.0]), np.diag([1, 1, -1.0]), np.full((3, 3), np.nan)])
def test_an_inverted_point_has_no_stress(F):
    law, pair = Muscle(**PAPER, activation=1.0, fibre=(1, 0, 0)), np.stack([EYE, F])
    for value in (law.energy(pair), law.stress(pair), law.tangent(pair)):
        assert np.isfinite(value[0]).all()
        assert np.isnan(value[1]).any()
    assert np.isnan(law.stress(pair)[1]).all()


def test_load_factor_scales_the_activation_alone():
    F, fibres = states()
    law = Muscle(**PAPER, activation=0.8, fibre=fibres)
    rest, half = law.at(0.0), law.at(0.5)
    assert (rest.activation, half.activation, law.activation) == (0.0, 0.4, 0.8)
    assert np.abs(half.stress(F) - 0.5 * (rest.stress(F) + law.stress(F))).max() < 1e-12 * np.abs(law.stress(F)).max()
    assert MATRIX.at(0.5) is MATRIX


def test_any_leading_shape_and_one_fibre_for_all():
    F, _ = states()
    F = F[:24].reshape(2, 3, 4, 3, 3)
    one = Muscle(**PAPER, activation=1.0, fibre=(1, 2, -1))
    each = Muscle(**PAPER, activation=1.0, fibre=np.broadcast_to([1.0, 2, -1], F.shape[:-1]))
    for name in ("energy", "stress", "tangent"):
        assert getattr(one, name)(F).shape[:3] == (2, 3, 4)
        assert np.array_equal(getattr(one, name)(F), getattr(each, name)(F))
    # one fibre a section, as a rod's tangents are
    some = Muscle(**PAPER, activation=1.0, fibre=directions(6).reshape(2, 3, 1, 3))
    assert np.array_equal(
        some.stress(F)[1, 2, 3], Muscle(**PAPER, activation=1.0, fibre=directions(6)[5]).stress(F[1, 2, 3])
    )


@pytest.mark.parametrize(
    ("given_", "message"),
    [
        ({"activation": 1.1}, "activation: got 1.1, need 0"),
        ({"activation": -0.1}, "activation: got -0.1, need 0"),
        ({"activation": np.nan}, "activation: got nan"),
        ({"sigma_max": -1.0}, "sigma_max: got -1, need a stress, not negative"),
        ({"sigma_max": np.inf}, "sigma_max: got inf"),
        ({"m1": -2.0}, "m1: got -2, need a stress, not negative"),
        ({"m2": -0.5}, "m2: got -0.5, need an exponent, not negative"),
        ({"fibre": (0, 0, 0)}, r"fibre direction: got \(0, 0, 0\), need a finite vector, not zero"),
        ({"fibre": (0, np.nan, 0)}, "need a finite vector"),
        ({"fibre": [(1, 0, 0), (0, 0, 0)]}, r"got \(0, 0, 0\)"),
        ({"fibre": (0, 1)}, r"got shape \(2,\), need \(3,\)"),
        ({"fibre": "along"}, "got 'along', need a vector"),
        ({"E": -1.0}, "E: got -1"),
        ({"nu": 0.6}, "nu: got 0.6"),
    ],
)
def test_refuses_constants_that_cannot_be(given_, message):
    with pytest.raises(InputError, match=message) as caught:
        Muscle(**(PAPER | {"fibre": (0, 1, 0)} | given_))
    assert "\n" not in str(caught.value)


def test_fibres_along_a_rod_need_a_rod():
    with pytest.raises(InputError, match="'tangent': only a body knows"):
        Muscle(**PAPER).stress(EYE[None])


def bar(law, held="", stretch=1.0, elements=2, order=2):
    """A cylinder along z of radius 0.5 and length 2, free to swell, its far end free or held at a stretch."""
    space = Space.paper(straight(radius=0.5, height=2.0), elements=elements, order=order)
    first = np.arange(space.layer_nodes)
    # Two control points lie on the x axis and two on the y axis: what holds the bar there leaves it free to swell.
    supports = [Support(first, "z"), Support([1, 3], "x"), Support([0, 2], "y")]
    if held:
        supports.append(Support.end(space, "end", "z", (0.0, 0.0, 2.0 * (stretch - 1.0))))
    return Model([Body(space, law)], supports)


def lateral(stretch, law=MATRIX):
    """Lateral stretch of the matrix under no lateral stress."""
    return brentq(lambda t: law.mu * t + (law.lame * np.log(t * t * stretch) - law.mu) / t, 0.3, 3.0, xtol=1e-15)


def axial(stretch, activation):
    t = lateral(stretch)
    matrix = MATRIX.mu * stretch + (MATRIX.lame * np.log(t * t * stretch) - MATRIX.mu) / stretch
    return matrix + activation * float(active(stretch)) + float(passive(stretch))


@pytest.mark.parametrize("fibre", ["tangent", (0.0, 0.0, -1.0)])
@pytest.mark.parametrize("activation", [0.3, 1.0])
def test_isometric_force_at_rest_length_is_the_largest_active_stress(activation, fibre):
    solution = statics.solve(bar(Muscle(**PAPER, activation=activation, fibre=fibre), held="z"))
    force = 30.0 * activation * np.pi * 0.25
    assert solution.reactions[[0, 3], 2] == pytest.approx([-force, force], rel=1e-12)
    assert np.abs(solution.displacement).max() < 1e-12


@pytest.mark.parametrize("stretch", [0.7, 0.9, 1.1, 1.25])
def test_isometric_force_at_other_lengths(stretch):
    solution = statics.solve(bar(Muscle(**PAPER, activation=1.0), held="z", stretch=stretch), load_steps=2)
    assert solution.reactions[3, 2] == pytest.approx(axial(stretch, 1.0) * np.pi * 0.25, rel=1e-9)


@pytest.mark.parametrize("activation", [0.2, 1.0])
def test_free_bar_shortens_until_the_matrix_bears_the_active_stress(activation):
    model = bar(Muscle(**PAPER, activation=activation))
    solution = statics.solve(model)
    stretch = brentq(lambda x: axial(x, activation), 0.55, 1.0, xtol=1e-15)
    body = model.bodies[0]
    _, F = body.space.displacement(model.nodal(solution.displacement), [[0.0, 0.0], [0.6, -0.5]], [0.1, 0.5, 1.0])
    expected = np.diag([lateral(stretch), lateral(stretch), stretch])
    assert stretch < 0.96
    assert np.abs(F - expected).max() < 1e-8
    stress = cauchy(body, model.nodal(solution.displacement), [[0.0, 0.0]], [0.3])
    assert np.abs(stress).max() < 1e-6 * 30.0
    # at half the load factor the fibres pull half as much
    halfway = cauchy(body, model.nodal(solution.displacement), [[0.0, 0.0]], [0.3], factor=0.5)
    pull = 0.5 * activation * float(active(stretch)) / lateral(stretch) ** 2
    assert halfway[0, 0] == pytest.approx(np.diag([0, 0, -pull]), abs=1e-6)


def test_passive_bar_at_rest_stays_at_rest():
    solution = statics.solve(bar(Muscle(**PAPER), held="z"))
    assert not solution.displacement.any()
    assert not solution.reactions.any()


def test_laws_in_a_row_share_the_force():
    """Bars in series, nu = 0, small strain: force = displacement / sum(length / (E area)).

    The axis has a kink between them.
    """
    space = Space.paper(straight(degree=1, breaks=(0.0, 1.0, 3.0, 4.0), radius=0.5, height=4.0))
    laws = [LinearElastic(5.0, 0.0), LinearElastic(1.0, 0.0), LinearElastic(20.0, 0.0)]
    supports = [Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, 0.1))]
    solution = statics.solve(Model([Body(space, laws)], supports))
    force = 0.1 / ((1 / 5 + 2 / 1 + 1 / 20) / (np.pi * 0.25))
    assert solution.reactions[1, 2] == pytest.approx(force, rel=1e-12)


def test_one_law_and_the_same_law_for_each_element_are_the_same():
    law = Muscle(**PAPER, activation=1.0)
    one, each = (
        statics.solve(bar(laws, "z", 0.8)).displacement for laws in (law, [law, Muscle(**PAPER, activation=1.0)])
    )
    assert np.array_equal(one, each)


def coil():
    line = helix(4.0, 1.5, 1, 4)
    return line.sweep(circle(5, 0.6))


def test_fibres_along_a_coil_are_its_tangents():
    """The centre line's tangent, by differences of points on it.

    The vector part of the law follows it, the other does not.
    """
    rod = coil()
    law, other = Muscle(**PAPER, activation=1.0), Muscle(**PAPER, activation=1.0, fibre=(0, 3.0, 4.0))
    space = Space.paper(rod, elements=8, quadrature="2x1x3")
    body = Body(space, [law] * 3 + [other] * 2 + [MATRIX] * 3)
    table = space.tabulate(0, 8)
    fibres = body.fibres(table)
    assert fibres.shape == (*table.weights.shape, 3)
    u, h = table.u[:3].ravel(), 1e-4
    center = np.zeros((u.size, 2))
    along = (
        sum(w * (rod.points(center, u + k * h) - rod.points(center, u - k * h)) for k, w in enumerate(WEIGHTS, 1)) / h
    )
    along /= np.linalg.norm(along, axis=1)[:, None]
    assert np.abs(fibres[:3] - along.reshape(3, 3, 1, 3)).max() < 1e-9
    assert np.abs(fibres[3:5] - [0, 0.6, 0.8]).max() < 1e-15
    assert not fibres[5:].any()
    part = body.fibres(space.tabulate(2, 5))
    assert np.array_equal(part, fibres[2:5])


def test_modulus_and_work_bound_those_of_the_law():
    """Taut fibres are as stiff as their tangent; from one end of their range to the other they do all their work."""
    law = Muscle(**PAPER, activation=0.7, fibre=(0, 0, 1))
    taut = law.at(0.0).tangent(np.diag([1.0, 1.0, 1.0 + 1e-9])[None])[0, 2, 2, 2, 2]
    assert law.modulus == pytest.approx(taut, rel=1e-6)
    short, long = (np.diag([1.0, 1.0, stretch])[None] for stretch in (0.5, 1.5))
    work = [law.energy(F) - law.at(0.0).energy(F) for F in (short, long)]
    assert law.activation_work == pytest.approx((work[1] - work[0]).item(), rel=1e-12)


@pytest.mark.parametrize("count", [0, 3, 5])
def test_refuses_a_wrong_number_of_laws(count):
    with pytest.raises(InputError, match=f"material: got {count} laws for 4 elements") as caught:
        Body(Space.paper(coil()), [MATRIX] * count)
    assert "\n" not in str(caught.value)
