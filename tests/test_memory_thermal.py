"""Laws with memory that expand: residual stress of a clamped bar, its creep, and motions that keep their energy."""

import numpy as np
import pytest
from refused import refused
from test_memory_motion import bar

from isorod import Thermal, dynamics, files
from isorod.command import solving
from isorod.material.plastic import Plastic
from isorod.material.viscous import Creep, Viscoelastic

RNG = np.random.default_rng(3)
LAWS = (
    Plastic(200e3, 0.3, [[0, 400], [0.1, 500]], 1000.0, 3.0),
    Viscoelastic(200e3, 0.3, [[0.5, 1.0]]),
    Creep(200e3, 0.3, 1e-12, 3.0),
)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_what_strain_is_left_is_the_laws(law) -> None:
    """``P = g^2 P(F / g)`` and so on, and the state is that of ``F / g``, but for what was lost: ``g^3`` of it."""
    own, g = law.lasting(0.7), 1.03
    warm = Thermal(own, 1e-4, 300.0)
    F, then = np.eye(3) + 0.05 * RNG.standard_normal((2, 40, 3, 3))
    assert warm.stress(F) == pytest.approx(g**2 * own.stress(F / g), rel=1e-9)
    assert warm.energy(F) == pytest.approx(g**3 * own.energy(F / g), rel=1e-9)
    assert np.abs(warm.tangent(F) / g - own.tangent(F / g)).max() < 1e-12 * np.abs(own.tangent(F / g)).max()
    after, other = warm.advanced(F, 1.0), own.advanced(F / g, 1.0)
    assert after.law.state[:, :-1] == pytest.approx(other.state[:, :-1], rel=1e-9, abs=1e-12)
    assert after.law.state[:, -1] == pytest.approx(g**3 * other.state[:, -1], rel=1e-9)
    assert after.stress(then) == pytest.approx(g**2 * other.stress(then / g), rel=1e-9)


CLAMPED = """
[rod.bar]
curve = {{straight = 8.0}}
section = {{circle = 1.0}}
law = {law}
expansion = 1e-5
temperature = {temperature}
temperature_history = {history}
[support.left]
end = "start"
mean = "fixed"
[support.right]
end = "end"
mean = "fixed"
[measure.force]
reaction = "right"
component = "z"
[measure.lost]
dissipated = "bar"
[analysis.statics]
end_time = {end}
"""


def _measured(tmp_path, **given):
    path = tmp_path / "bar.toml"
    path.write_text(CLAMPED.format(**given))
    scene = files.find(str(path))
    return scene.measure(solving.solve(scene, scene.settings())[0])


@pytest.mark.parametrize(("nu", "temperature"), [(0.3, "200.0"), (0.3, '"200 + 0*r"'), (0.5, "200.0")])
def test_a_clamped_bar_heated_until_it_yields_and_cooled(nu, temperature, tmp_path) -> None:
    law = f"{{Plastic = {{E = 200e3, nu = {nu}, hardening = [[0, 200], [0.1, 200.0001]]}}}}"
    found = _measured(tmp_path, law=law, temperature=temperature, history="[[0, 0], [1, 1], [2, 0]]", end=2.0)
    flown = np.log(1.002) - 200.0 / 200e3
    assert found["force"] == pytest.approx(200e3 * flown * np.pi, rel=1e-5)
    # It flows while it is larger by 1.5 thousandths in the mean, 2 at the end of the step.
    assert found["lost"] == pytest.approx(1.0015**3 * 200.0 * flown * 8.0 * np.pi, rel=2e-3)


def test_what_expands_freely_has_no_error_of_forces_that_are_rounding(tmp_path) -> None:
    """A core that yields in a shell, heated and cooled: load steps are doubled for what moves, not for its support."""
    path = tmp_path / "bar.toml"
    metal = "{Plastic = {E = 200e3, nu = 0.3, hardening = [[0, 100], [0.1, 300]]}}"
    text = CLAMPED.format(
        law=f"[{metal}, {{NeoHookean = {{E = 100e3, nu = 0.3}}}}]",
        temperature=150.0,
        history="[[0, 0], [1, 1], [2, 0]]",
        end=2.0,
    )
    text = text.replace(
        "expansion = 1e-5",
        "rings = [0.0, 0.5, 1.0]\nexpansion = [2e-5, 1e-5]\nspace = {elements = 2, section_degree = 2}",
    )
    path.write_text(text[: text.index("[support.right]")] + text[text.index("[measure.lost]") :])
    scene = files.find(str(path))
    found = solving.solve(scene, scene.settings())[0]
    assert found.load_steps <= 8
    assert found.steps_error < 2.5e-3
    assert np.abs(found.reactions).max() < 1e-6 * 150.0 * 1e-5 * 100e3


@pytest.mark.slow  # its steps: half a minute
def test_a_clamped_bar_that_was_heated_creeps(tmp_path) -> None:
    """``s' = -E A s^n`` of what is left of the strain, and of a bar that is wider by ``g``."""
    law = "{Creep = {E = 200e3, nu = 0.3, A = 1e-9, n = 3.0}}"
    found = _measured(tmp_path, law=law, temperature=100.0, history="[[0, 0], [0.001, 1], [1, 1]]", end=1.0)
    left = ((200e3 * np.log(1.001)) ** -2 + 2.0 * 200e3 * 1e-9) ** -0.5
    assert -found["force"] == pytest.approx(np.pi * 1.001**3 * left, rel=1e-3)


def test_motions_keep_their_energy() -> None:
    model = bar(Thermal(Plastic(2.6, 0.3, [[0.0, 2e-4], [0.1, 2e-3]], 0.05), 1e-4, 1.0))
    long, short = (dynamics.solve(model, 6.0, step, outputs=2) for step in (0.05, 0.025))
    assert long.energy_error[-1] == pytest.approx(4.0 * short.energy_error[-1], rel=0.02)
    slow = dynamics.solve(model, 6.0, 0.05, outputs=2, integrator="implicit")
    assert np.abs(slow.energy_error).max() < 1e-7
    assert short.dissipated[-1] == pytest.approx(slow.dissipated[-1], rel=0.01)


test_constants_that_depend_on_the_temperature = refused(
    (lambda: Thermal(LAWS[0], 1e-5, 10.0, [[0, 1], [20, 0.5]]), "constants of Plastic do not depend"),
)
