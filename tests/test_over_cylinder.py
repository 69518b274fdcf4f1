"""Rods solved over a cylinder, beside elastica and rope; ``python -m comparisons.contact.over_cylinder`` has more."""

from pathlib import Path

import numpy as np
import pytest

from comparisons.contact import over_cylinder
from comparisons.contact.capstan import Capstan, friction_ratio
from isorod import files
from isorod.command import solving
from isorod.files.scene import FileScene

pytestmark = pytest.mark.filterwarnings("ignore:contact 0")


@pytest.mark.parametrize("pull", [0.75, 1.0, 3.0])
def test_arc_is_seen_in_forces_at_points(pull):
    """Its end force spread evenly over as much on either side changes what is seen by the square of that."""
    half, _, line, end = Capstan(1.0, 1.0, np.pi, pull).touch()
    angles, even = (np.arange(4000) + 0.5) * half / 4000, np.full(4000, line * half / 4000)
    errors = []
    for width in (0.02, 0.01):
        spread = half + width * np.linspace(-1.0, 1.0, 101)
        seen = np.append(angles, spread), np.append(even, np.full(101, end / 101))
        errors.append(np.subtract(over_cylinder.arc_of(*seen), (half, line, end)))
    assert np.abs(errors[1]).max() < 2e-3
    np.testing.assert_allclose(errors[0], 4.0 * errors[1], rtol=0.05, atol=1e-6)


def test_limits_of_what_is_known():
    ratios = 10.0, 14.0, 20.0
    assert over_cylinder.even_limit(ratios, [0.3 + 7.0 / ratio**2 for ratio in ratios]) == pytest.approx(0.3)
    assert over_cylinder.limit(ratios, [0.3 - 2.0 / ratio + 7.0 / ratio**2 for ratio in ratios]) == pytest.approx(0.3)


def test_rod_bent_round_a_cylinder_lies_on_an_arc():
    """A thick rod, with the contact's defaults: tension in the middle, and arc and forces but for its thickness."""
    found = over_cylinder.bent(5.0, 1.0, size=2.0)
    thin = Capstan(1.0, 1.0, np.pi, 1.0).touch()
    assert found.top_tension == pytest.approx(0.5, rel=0.02)
    assert found.line_force == pytest.approx(found.top_tension, rel=1e-6)
    assert found.half_angle == pytest.approx(thin.half_angle, rel=0.08)
    assert found.end_force == pytest.approx(thin.end_force, rel=0.02)


def test_hauled_rope_pulls_by_friction():
    """A thick one: what is missing shrinks with its thickness."""
    found = over_cylinder.hauled(5.0, size=2.0)
    assert found.sticking == 0
    assert found.tensions == pytest.approx(friction_ratio(over_cylinder.FRICTION, over_cylinder.WRAP), rel=0.04)


@pytest.mark.slow
def test_heavy_rope_has_to_be_pulled_below_the_bound_and_held_back_above():
    """A thick one has less in reserve than a thin one, 0.2 and -0.2."""
    assert over_cylinder.reserve(10.0, 0.8) == pytest.approx(0.039, abs=0.005)
    assert over_cylinder.reserve(10.0, 1.2) == pytest.approx(-0.37, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "slowest", "fastest"), [(0.8, -0.01, 0.01), (1.2, 0.05, 0.2)])
def test_heavy_rope_let_go_holds_below_the_bound_and_slides_above(share, slowest, fastest):
    """Let go at both ends it swings, which dies out, and, above the bound, goes on as fast as its damping lets it."""
    assert slowest < over_cylinder.released(10.0, share, size=2.0, lasting=1.5) < fastest


ROPE = """
[rod.rope]
curve = {{polyline = {points}, fillet = {around}}}
section = {{circle = {radius}}}
law = {{NeoHookean = {{E = {modulus}, nu = 0.3}}}}
[obstacle.drum]
Cylinder = {{point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0], radius = 10.0}}
[contact.drum]
first = "rope"
second = "drum"
friction = 0.2
[support.pull]
end = "end"
components = "{along}"
displacement = {pull}
[support.in_plane]
end = "end"
components = "z"
[support.slack]
end = "start"
components = "z"
[load.slack]
end = "start"
force = [0.0, -10.0, 0.0]
[analysis.statics]
[measure.pull]
reaction = "pull"
component = "{along}"
"""


def pull_of(path, radius, wrap):
    """Force that makes a rope of a file slide on a drum of radius 10, its slack end pulled by 10."""
    c = 10.0 + radius
    quarter = wrap == 90
    path.write_text(
        ROPE.format(
            points=[[-c, -6.0, 0.0], [-c, c, 0.0], *([[6.0, c, 0.0]] if quarter else [[c, c, 0.0], [c, -6.0, 0.0]])],
            around=c,
            radius=radius,
            # As stiff along whatever the radius.
            modulus=1e4 / radius**2,
            along="x" if quarter else "y",
            pull=[0.05, 0.0, 0.0] if quarter else [0.0, -0.05, 0.0],
        )
    )
    scene = FileScene(str(path))
    return abs(scene.measure(solving.solve(scene, scene.settings())[0])["pull"])


@pytest.mark.slow
@pytest.mark.parametrize("wrap", [90, 180])
def test_a_rope_of_a_file_slides_round_a_drum_as_a_thin_one_does(wrap, tmp_path):
    """Nobody chose a space, a penalty or a load step; what its thickness adds goes with it."""
    thick, thin = (pull_of(tmp_path / "rope.toml", radius, wrap) for radius in (0.5, 0.25))
    assert 2.0 * thin - thick == pytest.approx(10.0 * friction_ratio(0.2, np.radians(wrap)), rel=0.02)


# Of that hose on twice the elements, section degree 8: the force that pulls it, and that of the contact.
PULL, PRESS = -1.4796, 2.0589


@pytest.mark.slow
@pytest.mark.parametrize("degree", [5, 6])
def test_a_hose_hauled_over_a_pulley_knows_its_error(degree):
    """It flattens too little on few section functions; all points slip, where the tangent is not symmetric."""
    path = Path(files.__file__).parent / "examples" / "contact" / "hose.toml"
    scene = FileScene(str(path), section_degree=degree)
    solution, _ = solving.solve(scene, scene.settings())
    (contact,), found = solution.contacts, scene.measure(solution)
    assert contact.sticking == 0 < contact.slipping
    error = abs(found["pull"] / PULL - 1.0)
    print(found, error, solution.estimate())
    assert error > 0.005
    assert 0.5 * error < solution.estimate() < 3.0 * error
    assert abs(found["press"] / PRESS - 1.0) < 1.5 * error
