"""The muscle law: fibre curves of the paper, derivatives, invariance, and bars whose force has a closed form."""

import numpy as np
import pytest
from conftest import straight
from scipy.integrate import quad
from scipy.optimize import brentq
from test_laws import FIBRE, F

from isorod import Body, InputError, Model, Muscle, NeoHookean, Space, Support, circle, helix, statics
from isorod.output.stress import cauchy
from isorod.tensors import rotation

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


def fibre_part(law, stretch):
    """Fibre stress of a stretch along the fibre, the rest of F being anything."""
    F = np.repeat([np.diag([1.1, 0.9, 1.0]) + np.outer(np.arange(3), [0, 0.05, 0])], stretch.size, axis=0)
    F[:, :, 2] = rotation((0.4, -0.3, 1.0))[:, 2] * stretch[:, None]
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


def test_one_law_and_the_same_law_for_each_element_are_the_same():
    law = Muscle(**PAPER, activation=1.0)
    one, each = (
        statics.solve(bar(laws, "z", 0.8)).displacement for laws in (law, [law, Muscle(**PAPER, activation=1.0)])
    )
    assert np.array_equal(one, each)


def test_parts_of_the_law_are_apart():
    """Without an exponent there is no passive stress; the load factor scales the activation alone."""
    slack = Muscle(30.0, 0.49, fibre=(0, 0, 1.0)), Muscle(**(PAPER | {"m2": 0.0}), fibre=(0, 0, 1.0))
    for law in slack:
        for name in ("energy", "stress"):
            np.testing.assert_allclose(getattr(law, name)(F), getattr(MATRIX, name)(F), rtol=1e-13, atol=1e-12)
    law = Muscle(**PAPER, activation=0.8, fibre=FIBRE)
    rest, half = law.at(0.0), law.at(0.5)
    assert (rest.activation, half.activation, law.activation) == (0.0, 0.4, 0.8)
    assert np.abs(half.stress(F) - 0.5 * (rest.stress(F) + law.stress(F))).max() < 1e-12 * np.abs(law.stress(F)).max()
    assert MATRIX.at(0.5) is MATRIX


def test_fibres_of_points_of_sections_and_of_all():
    grid = F[:24].reshape(2, 3, 4, 3, 3)
    one = Muscle(**PAPER, activation=1.0, fibre=(1, 2, -1))
    each = Muscle(**PAPER, activation=1.0, fibre=np.broadcast_to([1.0, 2, -1], grid.shape[:-1]))
    for name in ("energy", "stress", "tangent"):
        assert np.array_equal(getattr(one, name)(grid), getattr(each, name)(grid))
    # One fibre a section, as a rod's tangents are.
    fibres = np.random.default_rng(1).normal(size=(6, 3))
    some = Muscle(**PAPER, activation=1.0, fibre=fibres.reshape(2, 3, 1, 3))
    alone = Muscle(**PAPER, activation=1.0, fibre=fibres[5])
    assert np.array_equal(some.stress(grid)[1, 2, 3], alone.stress(grid[1, 2, 3]))


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
    fibres = body.known(table)
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
    part = body.known(space.tabulate(2, 5))
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
