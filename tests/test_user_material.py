"""Materials of the user's own against laws of the house: a function, a UMAT in Fortran, MFront's interface in C."""

import shutil
import subprocess
from pathlib import Path

import numba
import numpy as np
import pytest
from refused import refused
from scipy.spatial.transform import Rotation

from isorod import (
    Body,
    Model,
    NeoHookean,
    Plastic,
    Space,
    Support,
    UserMaterial,
    circle,
    dynamics,
    modal,
    statics,
    straight,
)
from isorod.errors import InputError
from isorod.files.scene import FileScene
from isorod.material.user import _code, library

SOURCES = Path(__file__).parent / "routines"
E, NU = 10.0, 0.3
MU, LAMBDA = E / 2.0 / (1.0 + NU), E * NU / (1.0 + NU) / (1.0 - 2.0 * NU)
METAL = [200e3, 0.3, 400.0, 1000.0]


def neo_hooke(F_old, F, state, dt, constants):
    """Neo-Hooke's law, and the largest ln J so far."""
    growth = np.log(np.linalg.det(F))
    state[0] = max(state[0], growth)
    inverse = np.linalg.inv(F).T
    return constants[0] * (F - inverse) + constants[1] * growth * inverse


def damper(F_old, F, state, dt, constants):
    """A spring in parallel with a branch that relaxes, of Green's strain."""
    e = 0.5 * (F.T @ F - np.eye(3))
    v = state.reshape((3, 3))
    v[:] = (v + dt / constants[1] * e) / (1.0 + dt / constants[1])
    return F @ (2.0 * constants[0] * e + 2.0 * constants[0] * (e - v))


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    """Return a folder with both routines in shared libraries."""
    folder = tmp_path_factory.mktemp("routines")
    for compiler, source, more in (("gfortran", "j2.f", []), ("cc", "neo_hooke.c", ["-lm"])):
        if shutil.which(compiler) is None:
            pytest.skip(f"no {compiler}")
        out = folder / Path(source).with_suffix(".so")
        subprocess.run([compiler, "-shared", "-fPIC", "-O2", "-o", out, SOURCES / source, *more], check=True)
    return folder


def _umat(built: Path) -> UserMaterial:
    return library(built / "j2.so", "umat_", states=1, constants=METAL)


def _mfront(built: Path) -> UserMaterial:
    return library(built / "neo_hooke.so", "neo_hooke", "mfront", states=1, constants=[MU, LAMBDA])


def _random(size: float, count: int = 40) -> np.ndarray:
    return np.eye(3) + size * np.random.default_rng(0).uniform(-1.0, 1.0, (count, 3, 3))


@pytest.mark.parametrize("kind", ["function", "mfront"])
def test_a_routine_is_the_law_it_computes(kind, built) -> None:
    law = UserMaterial(neo_hooke, 1, [MU, LAMBDA]) if kind == "function" else _mfront(built)
    known, F = NeoHookean(E, NU), _random(0.3)
    np.testing.assert_allclose(law.stress(F), known.stress(F), rtol=0.0, atol=1e-12 * E)
    error = 1e-8 if kind == "function" else 1e-12
    np.testing.assert_allclose(law.tangent(F), known.tangent(F), rtol=0.0, atol=error * E)
    law = law.advanced(F, 0.5).advanced(_random(0.1), 1.0)
    growth = [np.log(np.linalg.det(one)) for one in (F, _random(0.1))]
    np.testing.assert_allclose(law.state[:, 25], np.maximum(np.maximum(*growth), 0.0), atol=1e-14)


def test_the_time_of_a_step_is_told() -> None:
    # v' = (e - v)/tau, implicit.
    law, F = UserMaterial(damper, 9, [2.0, 0.5]), _random(0.01)
    e, v = 0.5 * (np.swapaxes(F, 1, 2) @ F - np.eye(3)), np.zeros((40, 3, 3))
    for time, step in ((0.2, 0.2), (1.0, 0.8)):
        v = (v + step / 0.5 * e) / (1.0 + step / 0.5)
        np.testing.assert_allclose(law.at(time).stress(F), F @ (4.0 * (e + e - v)), rtol=0.0, atol=1e-14)
        law = law.advanced(F, time)


def test_a_umat_in_small_strains_is_plasticity(built) -> None:
    law, known = _umat(built), Plastic(200e3, 0.3, [[0.0, 400.0], [1.0, 1400.0]])
    for k in range(4):
        F = _random(0.001 * (k + 1))
        stress = known.stress(F)
        np.testing.assert_allclose(law.stress(F), stress, rtol=0.0, atol=0.015 * np.abs(stress).max())
        law, known = law.advanced(F, float(k + 1)), known.advanced(F, float(k + 1))
    flown = law.state[:, 25]
    assert np.median(flown) > 1e-3
    np.testing.assert_allclose(flown, known.state[:, 6], rtol=0.0, atol=0.02 * flown.max())


def test_moduli_of_a_umat_are_the_derivative_of_its_stress(built) -> None:
    # Where it flows they differ by what the midpoint rule of a step leaves out, of the size of its strain.
    law = _umat(built).advanced(_random(0.004), 1.0)
    F = _random(0.004) + 0.002 * (_random(1.0)[::-1] - np.eye(3))
    way = np.random.default_rng(1).normal(size=F.shape)
    found = (law.stress(F + 1e-7 * way) - law.stress(F - 1e-7 * way)) / 2e-7
    linear = np.einsum("naAbB,nbB->naA", law.tangent(F), way)
    assert np.abs(found - linear).max() < 0.02 * np.abs(found).max()


def test_a_umat_knows_the_time_and_its_first_increment(tmp_path) -> None:
    if shutil.which("gfortran") is None:
        pytest.skip("no gfortran")
    subprocess.run(["gfortran", "-shared", "-fPIC", "-o", tmp_path / "clock.so", SOURCES / "clock.f"], check=True)
    space = Space(straight(4.0).sweep(circle(8, 1.0)), section_degree=2, elements=1, degree=2)
    body = Body(space, library(tmp_path / "clock.so", "umat_", states=3), 1.0)
    supports = [Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, 0.1))]
    found = statics.solve(Model([body], supports), load_steps=4, end_time=2.0)
    # Of the last of four steps: time at its beginning, KINC, and times that KINC was 1.
    known = [float(found.state(f"state_{k}", 0, 0.5, [[0.5, 0.0]]).squeeze()) for k in (1, 2, 3)]
    assert known == pytest.approx([1.5, 2.0, 1.0])


def test_moduli_of_a_umat_have_the_terms_of_its_stress(built) -> None:
    # Of Jaumann's rate, tau' = J C:D + W tau - tau W, at stresses as large as moduli, in numpy; the symmetric part.
    law = library(built / "j2.so", "umat_", states=1, constants=[1.0, 0.3, 1e9, 0.0]).advanced(_random(0.3, 1), 1.0)
    F = _random(0.3, 1)[0]
    mu, lame, inverse = 1.0 / 2.6, 0.3 / 1.3 / 0.4, np.linalg.inv(F)
    tau = law.stress(F[None])[0] @ F.T
    known = np.empty((3, 3, 3, 3))
    for b in range(3):
        for B in range(3):
            L = np.outer(np.eye(3)[b], inverse[B])
            D, W = 0.5 * (L + L.T), 0.5 * (L - L.T)
            rate = np.linalg.det(F) * (2.0 * mu * D + lame * np.trace(D) * np.eye(3)) + W @ tau - tau @ W - tau @ L.T
            known[:, :, b, B] = rate @ inverse.T
    assert np.abs(tau).max() > 0.1
    known = 0.5 * (known + known.transpose(2, 3, 0, 1))
    np.testing.assert_allclose(law.tangent(F[None])[0], known, rtol=0.0, atol=1e-12)


def test_a_behaviour_of_an_older_interface_is_refused(built, tmp_path) -> None:
    for release, words in (("3.4.0", "made by TFEL 3.4.0, need 4 or later"), ("4.2.0", "")):
        out = tmp_path / f"{release}.so"
        words_of_cc = ["cc", "-shared", "-fPIC", f'-DRELEASE="{release}"', "-o", out, SOURCES / "neo_hooke.c", "-lm"]
        subprocess.run(words_of_cc, check=True)
        given = (out, "neo_hooke", "mfront", 1, [MU, LAMBDA])
        if words:
            with pytest.raises(InputError, match=words):
                library(*given)
        else:
            library(*given)


def test_what_turns_afterwards_has_the_stress_turned(built) -> None:
    law, F = _umat(built).advanced(_random(0.004), 1.0), _random(0.004)
    turned = F
    for k in range(1, 13):
        turned = Rotation.from_rotvec(k * np.radians([10.0, 20.0, -5.0])).as_matrix() @ F
        law = law.advanced(turned, 1.0 + k)
    known = Rotation.from_rotvec(12 * np.radians([10.0, 20.0, -5.0])).as_matrix() @ _umat(built).stress(F)
    np.testing.assert_allclose(law.stress(turned), known, rtol=0.0, atol=1e-9 * np.abs(known).max())


def test_a_routine_that_asks_for_a_shorter_step_gets_one(built) -> None:
    far = np.diag([0.4, 0.4, 6.25])[None]
    assert np.isnan(_umat(built).stress(far)).all()
    assert np.isfinite(_umat(built).stress(np.diag([0.8, 0.8, 1.5625])[None])).all()


def _bar(law: UserMaterial | NeoHookean, **motion: tuple) -> Model:
    space = Space(straight(4.0).sweep(circle(8, 1.0)), section_degree=2, elements=2, degree=3)
    return Model([Body(space, law, 1.0)], [Support.end(space, "start"), Support.end(space, "end", **motion)])


def test_a_bar_of_a_function_is_that_of_the_law() -> None:
    motion = {"displacement": (0.0, 1.0, -0.5), "turn": (0.4, 0.0, 0.6)}
    found = statics.solve(_bar(UserMaterial(neo_hooke, 1, [MU, LAMBDA]), **motion), 4, end_time=1.0)
    known = statics.solve(_bar(NeoHookean(E, NU), **motion), 4)
    np.testing.assert_allclose(found.reactions, known.reactions, rtol=1e-8, atol=1e-8)


def test_a_bar_of_a_umat_flows(built, tmp_path, monkeypatch) -> None:
    (tmp_path / "j2.so").write_bytes((built / "j2.so").read_bytes())
    file = tmp_path / "bar.toml"
    file.write_text("""
[rod.bar]
curve = {straight = 4.0}
section = {circle = 1.0}
law = {UserMaterial = {path = "j2.so", function = "umat_", states = 1, constants = [200e3, 0.3, 400, 1000]}}
space = {elements = 1, degree = 2}
[support.left]
end = "start"
mean = "fixed"
[support.right]
end = "end"
mean = "fixed"
displacement = [0.0, 0.0, 0.04]
[analysis.statics]
end_time = 1.0
""")
    monkeypatch.delenv("ISOROD_LIBRARIES", raising=False)
    with pytest.raises(InputError, match=r"path: j2.so: a program; if you trust it, ISOROD_LIBRARIES=.* lets it run"):
        FileScene(str(file)).model()
    monkeypatch.setenv("ISOROD_LIBRARIES", str(tmp_path))
    found = statics.solve(FileScene(str(file)).model(), end_time=1.0)
    # Cauchy's stress of the flow, on the section as it has become: 1 % longer, volume by that of the stress alone.
    strain = np.log(1.01)
    stress = (400.0 + 1000.0 * strain) / (1.0 + 1000.0 / 200e3)
    section = np.pi / 1.01 * np.exp(stress * 0.4 / 200e3)
    assert found.reactions[1, 2] == pytest.approx(stress * section, rel=2e-5)
    flown = found.state("state_1", 0, 0.5, [[0.5, 0.0]])
    np.testing.assert_allclose(flown, strain - stress / 200e3, rtol=1e-4)


CODE = """
import numpy as np
def power(x):
    return {power}
def routine(F_old, F, state, dt, constants):
    return np.array([[power(F[i, j]) for j in range(3)] for i in range(3)]) * np.{name}(0.0)
"""


def test_a_function_is_known_by_its_code_wherever_that_is() -> None:
    def written(power="x", name="exp") -> str:
        made = {}
        exec(CODE.format(power=power, name=name), made)
        return repr(_code(numba.njit(made["routine"])))

    assert written() == written()
    assert len({written(), written(power="x + 0.0 * x**2"), written(name="cosh")}) == 3


test_what_cannot_be_is_said = refused(
    (lambda: UserMaterial(lambda F_old, F, state, dt, constants: F, 0), "routine: a stress of 1 at rest, need none"),
    (lambda: UserMaterial(lambda F_old, F, state, dt, c: F + F.T - 2.0 * np.eye(3), 0), "stress of .* in a rotation"),
    (lambda: UserMaterial(lambda F_old, F, state, dt, c: F[:2, :2] - 1.0, 0), "largest modulus at rest is nan"),
    (lambda: UserMaterial(neo_hooke, 24, [MU, LAMBDA]), "routine: got 24 state variables, need 0 to 23"),
    (lambda: UserMaterial(neo_hooke, 1, [np.nan, 1.0]), "routine, constants: "),
    (lambda: UserMaterial(neo_hooke, 1, [0.0, 0.0]), "routine: the largest modulus at rest is 0, need a finite one"),
)


def test_what_a_routine_does_not_tell_is_refused(built, tmp_path) -> None:
    model = _bar(_mfront(built))
    found = statics.solve(model, 1, end_time=1.0)
    for call, words in (
        (lambda: library(built / "j2.so", "umat"), "it has no function 'umat'"),
        (lambda: library(SOURCES / "j2.f", "umat_"), "cannot be loaded"),
        (lambda: modal.solve(model, state=found), "modes and motions do not take routines"),
        (lambda: dynamics.solve(model, 1.0), "UserMaterial does not compute its dissipation"),
        (lambda: found.energy(0), "does not compute its stored energy"),
        (lambda: found.state("p", 0, 0.5), "laws here have 'state_1'"),
    ):
        with pytest.raises(InputError, match=words):
            call()
