"""Vibration modes of the mixed formulation: exact solutions, the dense pencil, states with stress, what refuses it."""

import numpy as np
import pytest
from conftest import straight
from reference import BLADE_FREQUENCIES
from scipy.linalg import eigh, null_space
from scipy.optimize import brentq
from scipy.special import iv, jv
from vibrations import clamped, sliding, stretching, turning

from isorod import Body, InputError, LinearElastic, Model, NeoHookean, Space, Support, matrices, modal, statics
from isorod.assembly.mixed import MixedAssembler
from isorod.command.cli import main
from isorod.modal.pencil import SPARE
from isorod.scenes.blade import Blade

MU = 1.0
NEARLY = [0.3, 0.4999, 0.499999, 0.5]


def law(nu, kind=LinearElastic):
    return kind(2.0 * MU * (1.0 + nu), nu)


def bar(nu, held=lambda space: [], length=6.0, density=1.0, kind=LinearElastic, **space):
    where = Space.paper(straight(n=8, height=length), **({"elements": 4, "degree": 5} | space))
    return Model([Body(where, law(nu, kind), density, "mixed")], held(where))


# Exact solutions


@pytest.mark.parametrize("nu", NEARLY)
def test_torsion_of_a_free_bar_knows_nothing_of_poissons_ratio(nu):
    """f_m = m / 2L sqrt(mu / rho): turned sections keep their volume and are in the space."""
    modes = modal.solve(bar(nu, density=4.0, elements=6), 12)
    assert modes.rigid == 6
    assert np.abs(modes.eigenvalues[:6]).max() < 1e-9 * modes.eigenvalues[6]
    assert modes.residuals.max() < 1e-8
    found = modes.frequencies[6:][turning(modes) > 0.999][:2]
    assert found == pytest.approx(np.arange(1, 3) / 12.0 * np.sqrt(MU / 4.0), rel=1e-7)


def pochhammer(k, nu):
    """Return omega of longitudinal waves in a bar of radius 1, mu = rho = 1: Pochhammer's and Chree's equation."""
    slow = 0.0 if nu == 0.5 else (1.0 - 2.0 * nu) / (2.0 - 2.0 * nu)

    def gap(omega):
        # Of swelling imaginary, of shear real: the wave is slower than the one and faster than the other.
        p, q = np.sqrt(k**2 - slow * omega**2), np.sqrt(omega**2 - k**2)
        shear, both = (q**2 - k**2) ** 2, q**2 + k**2
        return (
            2.0 * p * both * iv(1, p) * jv(1, q)
            + shear * iv(0, p) * jv(1, q)
            - 4.0 * k**2 * p * q * iv(1, p) * jv(0, q)
        )

    slender = k * np.sqrt(2.0 * (1.0 + nu))
    return brentq(gap, 0.9 * slender, 1.05 * slender, xtol=1e-14)


@pytest.mark.parametrize("nu", [0.3, 0.4999, 0.5])
def test_longitudinal_waves_are_pochhammers_and_chrees(nu):
    """Ends in their planes, free of shear: k = pi / L is exact, as is the incompressible limit of the equation."""
    k = 0.5
    modes = modal.solve(bar(nu, sliding, np.pi / k, order=3, elements=6), 8)
    assert modes.rigid == 3
    (found, *_) = np.sqrt(modes.eigenvalues[3:][stretching(modes) > 0.1])
    assert found == pytest.approx(pochhammer(k, nu), rel=1e-8)


@pytest.mark.parametrize("stretch", [0.8, 1.3])
def test_torsion_of_a_stretched_incompressible_bar(stretch):
    """A stretch takes from a section's stiffness in torsion, 1 / s, what it takes from its inertia.

    That it is so is the pressure's doing, mu (1 - 1 / s) here.
    """
    length = 6.0
    F = np.diag([stretch**-0.5, stretch**-0.5, stretch])

    def held(space):
        first, last = (Support.end(space, end).nodes for end in ("start", "end"))
        moved = space.positions @ (F - np.eye(3))
        return [Support(first, "xyz", moved[first]), Support(last, "z", (0.0, 0.0, (stretch - 1.0) * length))]

    model = bar(0.5, held, length, kind=NeoHookean)
    modes = modal.solve(model, 8, state=statics.solve(model))
    assert modes.rigid == 0
    assert modes.frequencies[turning(modes) > 0.999][0] == pytest.approx(np.sqrt(MU) / (4.0 * length), rel=1e-7)


# The dense pencil


def dense(found):
    """Return all finite eigenvalues of stiffness and mass with pressures, which are taken out."""
    K, M = found.stiffness.toarray(), found.mass.toarray()
    still = found.places[0] < 0
    A, B, C = K[~still][:, ~still], K[~still][:, still], -K[still][:, still]
    assert np.abs(M[still]).max() == 0.0
    M = M[~still][:, ~still]
    if np.abs(C).max() > 0.0:
        return eigh(A + B @ np.linalg.solve(C, B.T), M, eigvals_only=True)
    Z = null_space(B.T)
    return eigh(Z.T @ A @ Z, Z.T @ M @ Z, eigvals_only=True)


SMALL = {"elements": 2, "degree": 3, "order": 2, "length": 3.0}


@pytest.mark.parametrize("lumped", [False, True])
@pytest.mark.parametrize("held", [clamped, lambda space: []], ids=["clamped", "free"])
@pytest.mark.parametrize("nu", [0.4, 0.5])
def test_the_lowest_eigenvalues_are_those_of_the_displacements_that_are_left(nu, held, lumped):
    model = bar(nu, held, **SMALL)
    modes = modal.solve(model, 14, lumped)
    exact = dense(modes.matrices())
    count = modes.eigenvalues.size
    assert modes.eigenvalues == pytest.approx(exact[:count], rel=1e-8, abs=1e-10 * exact[modes.rigid])
    assert modes.below == np.count_nonzero(exact <= modes.eigenvalues[-1] * (1.0 + 1e-7))


@pytest.mark.parametrize("nu", [0.5, 0.4994, 0.49, 0.48])
def test_all_finite_eigenvalues_but_some_can_be_had_and_no_more(nu):
    model = bar(nu, clamped, **(SMALL | {"elements": 1, "order": 1}))
    (body,) = model.bodies
    most = model.unknowns - body.pressures.size - SPARE
    found = modal.solve(model, most).eigenvalues
    exact = dense(matrices(model))
    if nu == 0.5:
        assert exact.size == most + SPARE
    assert found == pytest.approx(exact[:most], rel=1e-7)
    with pytest.raises(InputError, match=rf"need 1 to {most} \(number of unknowns, less the pressures and {SPARE}\)"):
        modal.solve(model, most + 1)


@pytest.mark.parametrize("stretch", [0.7, 1.2])
@pytest.mark.parametrize("nu", [0.49, 0.5])
def test_modes_about_a_state_are_those_of_its_tangent(nu, stretch):
    """Pushed to 0.7 a bar of three radii has modes that grow."""

    def held(space):
        return [
            Support.end(space, "start"),
            Support.end(space, "end", displacement=(0.0, 0.0, (stretch - 1.0) * 9.0)),
        ]

    model = bar(nu, held, kind=NeoHookean, **(SMALL | {"length": 9.0}))
    state = statics.solve(model, 2)
    modes = modal.solve(model, 6, state=state)
    exact = dense(state.matrices())
    assert modes.eigenvalues == pytest.approx(exact[:6], rel=1e-7)
    assert (exact[0] < 0.0) == (stretch < 1.0)
    assert dense(modes.matrices()) == pytest.approx(exact, rel=1e-10)


@pytest.mark.parametrize("lumped", [False, True])
def test_the_mass_is_that_of_the_displacements(lumped):
    """With held and tied unknowns, whose numbers are not those of the displacements alone."""
    where = Space.paper(straight(n=6, height=3.0), elements=2, degree=3)
    ends = [Support.end(where, "start", "xz"), Support.end(where, "end", "z", tied="xy")]
    bodies = [Body(where, law(0.4), 2.0, formulation) for formulation in ("mixed", "displacement")]
    mixed, plain = (matrices(Model([body], ends), lumped=lumped) for body in bodies)
    found, expected = ((one.expansion @ one.mass @ one.expansion.T).toarray() for one in (mixed, plain))
    assert np.array_equal(found, expected)
    assert np.count_nonzero(mixed.mass.toarray().any(axis=1)) == plain.mass.shape[0]


def test_bodies_of_both_formulations_vibrate_as_each_by_itself():
    soft, plain = (Space.paper(straight(n=6, height=h), elements=2, degree=3, order=2) for h in (3.0, 4.0))
    bodies = [Body(soft, law(0.5), 1.0), Body(plain, law(0.3), 1.0)]
    assert [body.formulation for body in bodies] == ["mixed", "displacement"]
    together = modal.solve(Model(bodies, [Support.end(soft, "start")]), 8)
    alone = [modal.solve(Model(bodies[:1], [Support.end(soft, "start")]), 8), modal.solve(Model(bodies[1:]), 8)]
    expected = np.sort(np.concatenate([one.eigenvalues[one.rigid :] for one in alone]))[:8]
    assert together.rigid == 6
    assert together.eigenvalues[6:] == pytest.approx(expected, rel=1e-9)


# By default


@pytest.mark.parametrize("nu", [0.49, 0.5])
def test_a_blade_near_incompressibility_is_right(nu):
    fine = modal.solve(Blade(nu=nu, section_degree=6, degree=6, continuity=0, elements=8).model())
    found = modal.solve(Blade(nu=nu).model())
    assert found.model.bodies[0].formulation == "mixed"
    assert found.frequencies == pytest.approx(fine.frequencies, rel=2.5e-3)
    error = np.abs(found.frequencies / fine.frequencies - 1.0).max()
    assert error < found.estimate() < 5e-3


def test_a_compressible_blade_loads_nothing_of_it(python):
    script = (
        "import sys; from isorod import options; options.initialize([]); from isorod import modal\n"
        "from isorod.scenes.blade import Blade\n"
        "print(modal.solve(Blade().model(), 1).frequencies[0])\n"
        "print([name for name in ('isorod.assembly.mixed', 'isorod.space.pressure') if name in sys.modules])"
    )
    frequency, loaded = python(script).stdout.splitlines()
    assert float(frequency) == pytest.approx(BLADE_FREQUENCIES[0], rel=5e-3)
    assert loaded == "[]"


# What refuses it


@pytest.mark.parametrize(
    ("typed", "instead"),
    [({"eps_type": name}, "krylovschur") for name in ("lobpcg", "gd", "lapack")] + [({"st_type": "shift"}, "sinvert")],
    ids=str,
)
def test_eigensolvers_that_need_a_definite_mass_are_refused(typed, instead):
    ((name, said),) = typed.items()
    with pytest.raises(
        InputError,
        match=f"-{name} {said}: needs a definite mass matrix, the mixed formulation's is singular; use {instead}",
    ):
        modal.solve(bar(0.5, clamped, **SMALL), 2, petsc=typed)


def test_an_unknown_state_has_no_pressure():
    model = bar(0.5, clamped, **SMALL)
    assembler = MixedAssembler(model)
    pressures = [np.arange(1.0, 1.0 + model.bodies[0].pressures.size).reshape(-1, model.bodies[0].pressures.count)]
    shape = np.random.default_rng(1).standard_normal(model.dofs)
    x = assembler.state(shape, pressures)
    assert assembler.pressures(x)[0] == pytest.approx(pressures[0], rel=1e-14)
    assert np.array_equal(assembler.displacement(x, 0.0), np.where(model.free >= 0, shape, 0.0))
    assert not np.any(assembler.pressures(assembler.state(shape))[0])


def test_modes_about_an_equilibrium_show_its_stresses(tmp_path):
    """Those of a mixed body have its pressures."""
    pyvista = pytest.importorskip("pyvista")
    (tmp_path / "bar.toml").write_text(
        '[rod.a]\ncurve = {straight = 12.0}\nsection = {circle = 1.0}\ndensity = 1.0\nformulation = "mixed"\n'
        "law = {NeoHookean = {E = 100.0, nu = 0.4999}}\nspace = {elements = 3, degree = 3, section_degree = 3}\n"
        '[support.foot]\nend = "start"\n[support.hand]\nend = "end"\ndisplacement = [0.0, 0.0, 0.12]\n'
        "[analysis.modal]\nmodes = 2\n"
    )
    assert main(["run", str(tmp_path / "bar.toml"), "--output", str(tmp_path / "out")]) == 0
    shown = pyvista.read(tmp_path / "out" / "bar-0.vtu")
    assert {"displacement", "mode_2", "mean_stress"} <= set(shown.point_data)
    # Away from the ends, which make it a little stiffer, a stretched bar has a third of its tension as the mean.
    middle = np.abs(shown.points[:, 2] - 6.0) < 1.0
    assert shown.point_data["mean_stress"][middle].mean() == pytest.approx(1.0 / 3.0, rel=0.12)
