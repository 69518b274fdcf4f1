"""Rods welded to finite element bodies in implicit motion: balances, a bar's wave, laws, ranks, files, bad input."""

import warnings

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import dolfinx.fem
import solids
import ufl
from motions import momenta
from mpi4py import MPI
from msh import box, content
from refused import refused
from solids import mesh, space
from test_files_solids import SCENE

from isorod import (
    LinearElastic,
    NeoHookean,
    SectionLoad,
    Space,
    StVenantKirchhoff,
    circle,
    dynamics,
    modal,
    statics,
    straight,
)
from isorod.dynamics.implicit.assembler import StepAssembler
from isorod.fenics.solid import Solid
from isorod.files.scene import FileScene
from isorod.material.muscle import Muscle
from isorod.model import Body, Model, Support
from isorod.model.tie import EndFace, SolidSurface, Tie

LAW = NeoHookean(10.0, 0.3)
SPIN, AHEAD = np.array([0.3, 0.8, 0.2]), np.array([1.0, -0.5, 0.2])


def below(points):
    """A block of 3 x 3 x 1 whose top is in the middle of ``z = 0``."""
    return (points - [0.5, 0.5, 1.0]) * [3.0, 3.0, 1.0]


def faces(domain, z):
    return solids.where(domain, lambda x: np.isclose(x[2], z))


def post(length=3.0, start=0.0, **keywords):
    return Space(straight(length, start=(0.0, 0.0, start)).sweep(circle(8)), **keywords)


def on_block(law=LAW, shape="hexahedron", counts=(3, 3, 2), degree=2, held=False, **keywords):
    """Return a rod on a block, and both."""
    one = space(mesh(shape, counts, place=below), degree)
    if held:
        dofs = dolfinx.fem.locate_dofs_topological(one, 2, faces(one.mesh, -1.0))
        keywords["conditions"] = [dolfinx.fem.dirichletbc(np.array([0.0, 0.02, 0.0]), dofs, one)]
    if "form" in keywords:
        keywords |= dict(zip(("form", "unknown"), keywords["form"](one), strict=True))
    block = Solid(one, law, 1.5, **keywords)
    rod = post(elements=2, order=2)
    tie = Tie(EndFace(0, "start"), SolidSurface(0, faces(one.mesh, 0.0)))
    return Model([Body(rod, LAW, 2.0)], ties=[tie], solids=[block]), rod, block


def thrown(rod, block):
    """Return the initial state of both that fly and turn as one."""
    velocity = np.cross(SPIN, rod.positions) + rod.is_control_point[:, None] * AHEAD
    return {"velocity": velocity.ravel(), "solids": [(0.0, (np.cross(SPIN, block.positions) + AHEAD).ravel())]}


def test_a_body_of_small_strains_that_turns_is_warned_of():
    model, rod, block = on_block(LinearElastic(10.0, 0.3), counts=(1, 1, 1), degree=1)
    for time, warned in ((0.04, False), (0.4, True)):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            dynamics.solve(model, time, time / 2.0, outputs=1, integrator="implicit", **thrown(rod, block))
        said = [str(one.message) for one in told if "rotations or strains of solid 0 reach" in str(one.message)]
        assert bool(said) == warned


def test_an_incompressible_rod_that_is_thrown_with_a_block_keeps_energy_and_momentum():
    model, rod, block = on_block(counts=(2, 2, 1))
    model = Model([Body(rod, NeoHookean(10.0, 0.5), 2.0)], ties=model.ties, solids=[block])
    found = dynamics.solve(model, 1.0, 0.2, outputs=5, integrator="implicit", **thrown(rod, block))
    assert found.pressure.any() and found.stored.max() > 0.05 * found.kinetic[0]
    assert np.abs(found.energy_error).max() < 1e-9
    assert found.momentum_error.max() < 1e-12


def states(found):
    """Return positions at rest and displacements and velocities of all nodes at outputs, and which nodes carry."""
    model = found.model
    space, block = model.bodies[0].space, model.solids[0]
    rest = np.concatenate([space.positions, block.positions])
    carries = np.append(space.is_control_point, np.ones(block.nodes))
    moved, moving = (
        np.concatenate([rods, others], axis=1).reshape(len(found), -1, 3)
        for rods, others in (
            (found.displacement, found.solid_displacement),
            (found.velocity, found.solid_velocity),
        )
    )
    return rest, moved, moving, carries


@pytest.mark.parametrize("law", [LAW, StVenantKirchhoff(10.0, 0.3)], ids=["NeoHookean", "StVenantKirchhoff"])
def test_a_rod_on_a_block_that_flies_and_turns_keeps_energy_and_both_momenta(law):
    model, rod, block = on_block(law)
    found = dynamics.solve(model, 2.0, 0.2, outputs=4, integrator="implicit", **thrown(rod, block))
    energy = found.kinetic + found.stored
    # Some of it is stored at times, in steps in which strains change by some per cent.
    assert found.stored.max() > 0.05 * energy[0]
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-9
    assert np.abs(found.energy_error).max() < 1e-9
    rest, moved, moving, carries = states(found)
    heavy = StepAssembler(model)
    momenta = np.array([heavy.momenta(one.ravel()).reshape(-1, 3) for one in moving])
    mass = 2.0 * 3.0 * np.pi + 1.5 * 9.0
    assert (carries @ momenta)[0] - mass * AHEAD == pytest.approx(
        np.cross(SPIN, 2.0 * 3.0 * np.pi * np.array([0.0, 0.0, 1.5]) + 1.5 * 9.0 * np.array([0.0, 0.0, -0.5])), rel=1e-9
    )
    for one in (carries @ momenta, np.cross(rest + moved, momenta).sum(axis=1)):
        assert np.abs(one - one[0]).max() < 1e-9 * np.abs(one).max()
    assert found.momentum_error.max() < 1e-12


def round_bar(points):
    """The lower half of a round bar of length 4."""
    a, b = 2.0 * points[:, 0] - 1.0, 2.0 * points[:, 1] - 1.0
    return np.stack([a * np.sqrt(1.0 - b**2 / 2.0), b * np.sqrt(1.0 - a**2 / 2.0), 2.0 * points[:, 2]], axis=1)


def test_a_bar_half_rod_half_elements_swings_with_the_frequency_of_a_whole_one():
    """Pulled and let go: of the first mode ``w = pi c / (2 L)``, and ``8 / pi^2`` of the displacement at the end."""
    length, density, modulus = 4.0, 1.5, 10.0
    law = LinearElastic(modulus, 0.0)
    one = space(mesh("hexahedron", (2, 2, 3), order=2, place=round_bar), 2)
    bottom = dolfinx.fem.locate_dofs_topological(one, 2, faces(one.mesh, 0.0))
    bar = Solid(one, law, density, [dolfinx.fem.dirichletbc(np.zeros(3), bottom, one)])
    rod = post(2.0, 2.0, elements=3, order=1)
    body, tie = Body(rod, law, density), Tie(EndFace(0, "start"), SolidSurface(0, faces(one.mesh, 2.0)))
    pull = SectionLoad.end(rod, "end", (0.0, 0.0, 1.0))
    pulled = statics.solve(Model([body], loads=[pull], ties=[tie], solids=[bar]))
    stretch = 1.0 / (np.pi * modulus)
    assert pulled.at(0, "end")[2] == pytest.approx(stretch * length, rel=2e-3)

    wave = 0.5 * np.pi / length
    frequency = wave * np.sqrt(modulus / density)
    points, weights = np.polynomial.legendre.leggauss(12)
    shape = np.zeros_like(bar.positions)
    shape[:, 2] = np.sin(wave * bar.positions[:, 2])

    def amplitude(state):
        """Return the share of the first mode, times its mass."""
        along = state.at(0, 0.5 * (1.0 + points) * rod.axis.breaks[-1])[:, 2]
        own = density * np.pi * weights @ (np.sin(wave * (3.0 + points)) * along)
        return own + bar.momenta(shape.ravel()) @ state.solids[0]

    first = amplitude(pulled)
    # Of density area stretch z, and a mass of density area L / 2.
    assert first == pytest.approx(density * np.pi * stretch / wave**2, rel=2e-3)

    def found(steps):
        """Return frequency and amplitude of what is nearest to a cosine over a period."""
        model, period = Model([body], ties=[tie], solids=[bar]), 2.0 * np.pi / frequency
        history = dynamics.solve(
            model,
            period,
            period / steps,
            outputs=10,
            integrator="implicit",
            displacement=pulled.displacement,
            solids=[(pulled.solids[0], 0.0)],
        )
        assert np.abs(history.energy_error).max() < 1e-12
        samples = np.array([amplitude(one) for one in history]) / first
        guess = np.array([1.0, frequency])
        for _ in range(10):
            angle = guess[1] * history.times
            columns = np.column_stack([np.cos(angle), -guess[0] * history.times * np.sin(angle)])
            guess += np.linalg.lstsq(columns, samples - guess[0] * np.cos(angle), rcond=None)[0]
        assert np.abs(samples - guess[0] * np.cos(guess[1] * history.times)).max() < 1e-3
        return guess

    coarse, middle, fine = (found(steps) for steps in (20, 40, 80))
    assert fine[0] == pytest.approx(1.0, abs=1e-3)
    assert fine[1] == pytest.approx(frequency, rel=5e-3)
    assert (coarse[1] - middle[1]) / (middle[1] - fine[1]) == pytest.approx(4.0, rel=0.02)
    # Without the error of the steps it is that of the modes, which have the same mass.
    modes = modal.solve(Model([body], ties=[tie], solids=[bar]), 6).frequencies
    limit = (fine[1] + (fine[1] - middle[1]) / 3.0) / (2.0 * np.pi)
    assert np.abs(modes / limit - 1.0).min() < 1e-4
    # Of second order, and as late as the step is.
    assert coarse[1] - fine[1] == pytest.approx(-frequency / 12.0 * 15.0 / 16.0 * (np.pi / 10.0) ** 2, rel=0.05)


def small_strains(one):
    """Return a form with the stress of LinearElastic(10, 0.25), and its unknown."""
    u, v = dolfinx.fem.Function(one), ufl.TestFunction(one)
    strain = ufl.sym(ufl.grad(u))
    stress = 4.0 * ufl.tr(strain) * ufl.Identity(3) + 8.0 * strain
    return ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 4}), u


def test_a_body_given_by_a_form_moves_as_that_of_its_law():
    found = []
    for keywords in ({"law": LinearElastic(10.0, 0.25)}, {"law": None, "form": small_strains}):
        model, rod, _ = on_block(held=True, counts=(2, 2, 1), **keywords)
        push = SectionLoad.end(rod, "end", (0.02, 0.0, 0.0))
        model = Model(model.bodies, loads=[push], ties=model.ties, solids=model.solids)
        found.append(dynamics.solve(model, 2.0, 0.25, outputs=4, integrator="implicit", damping=0.1))
    by_law, by_form = found
    assert by_form.displacement == pytest.approx(by_law.displacement, abs=1e-10)
    assert by_form.solid_velocity == pytest.approx(by_law.solid_velocity, abs=1e-10)
    # What a form stores no one knows; the work on it since the start is what a law has stored since.
    assert by_form.stored - by_form.stored[0] == pytest.approx(by_law.stored - by_law.stored[0], abs=1e-10)
    assert by_law.stored[0] > 1e-3
    for one in found:
        assert np.abs(one.energy_error).max() < 1e-9
        assert one.momentum_error.max() < 1e-9


def test_work_of_activation_and_of_loads_on_a_body_is_in_the_balance():
    def pull(one):
        return ufl.inner(dolfinx.fem.Constant(one.mesh, np.array([0.05, 0.0, 0.0])), ufl.TestFunction(one)) * ufl.dx

    law = Muscle(E=10.0, nu=0.3, sigma_max=1.0, m1=0.4, m2=2.0, activation=0.8, fibre=(0.0, 1.0, 1.0))
    one = space(mesh("tetrahedron", (2, 2, 1), place=below), 2)
    block = Solid(one, law, 1.5, load=pull(one))
    tie = Tie(EndFace(0, "start"), SolidSurface(0, faces(one.mesh, 0.0)))
    model = Model([Body(post(elements=2), LAW, 2.0)], ties=[tie], solids=[block])
    found = dynamics.solve(model, 2.0, 0.2, outputs=5, integrator="implicit", ramp=1.0)
    assert found.muscle_work[-1] > 0.01 and found.load_work[-1] > 0.01
    assert np.abs(found.energy_error).max() < 1e-7
    assert found.momentum_error.max() < 1e-10


@pytest.mark.parametrize(("slave", "width"), [("rod", 1.0), ("solid", 0.4)])
def test_a_support_of_the_rod_carries_what_the_body_does_in_motion(slave, width):
    """A block that hangs on a short stiff rod: the force on the support is that of the momentum that is lost."""
    one = space(mesh("hexahedron", (2, 2, 1), place=lambda x: width * below(x)), 2)
    block = Solid(one, LAW, 1.5)
    rod = post(1.0, elements=2)
    # The slave is what the other covers.
    sides = EndFace(0, "start"), SolidSurface(0, faces(one.mesh, 0.0))
    tie = Tie(*sides) if slave == "rod" else Tie(*sides[::-1])
    model = Model([Body(rod, LAW, 2.0)], [Support.end(rod, "end")], ties=[tie], solids=[block])
    found = dynamics.solve(model, 1.0, 0.05, outputs=20, integrator="implicit", solids=[(0.0, (0.0, 0.2, 0.0))])
    assert found.momentum_error.max() < 1e-9
    _, _, moving, carries = states(found)
    heavy = StepAssembler(model)
    momentum = np.array([carries @ heavy.momenta(one.ravel()).reshape(-1, 3) for one in moving])
    # The trapezoidal rule of smooth forces, which begin where the velocity jumps.
    impulse = 0.05 * (0.5 * (found.reactions[1:, 0] + found.reactions[:-1, 0])).sum(axis=0)
    assert np.abs(impulse - momentum[-1] + momentum[0]).max() < 0.1 * np.abs(momentum[0]).max()


def test_a_resumed_run_is_that_which_was_not_stopped(tmp_path):
    model, _, _ = on_block(held=True, counts=(2, 2, 1))
    given = {"outputs": 4, "integrator": "implicit", "solids": [(0.0, (0.1, 0.0, 0.0))]}
    whole = dynamics.solve(model, 1.0, 0.25, **given)
    kept = tmp_path / "state"
    half = given | {"outputs": 2, "checkpoint": kept}
    dynamics.solve(model, 0.5, 0.25, **half)
    on = dynamics.solve(model, 1.0, 0.25, resume=True, **(half | {"outputs": 4}))
    for name in ("displacement", "solid_displacement", "solid_velocity", "stored", "energy_error"):
        assert np.array_equal(getattr(on, name), getattr(whole, name)), name
    assert on[-1].function(0).x.array == pytest.approx(whole.solid_displacement[-1])
    heavier = Model(model.bodies, ties=model.ties, solids=[Solid(model.solids[0].space, LAW, 1.6)])
    with pytest.raises(ValueError, match="belongs to another model"):
        dynamics.solve(heavier, 1.0, 0.25, resume=True, **(half | {"outputs": 4}))


def test_what_a_block_exerts_on_a_rod_changes_its_momentum():
    model, rod, _ = on_block(LinearElastic(10.0, 0.3))
    step = 0.02
    velocity = 1e-5 * (np.cross(SPIN, rod.positions) + rod.is_control_point[:, None] * AHEAD)
    found = dynamics.solve(model, 30 * step, step, outputs=30, integrator="implicit", velocity=velocity.ravel())
    own = momenta(Model([model.bodies[0]]), found.velocity).sum(axis=1)
    rate = (own[2:] - own[:-2]) / (2.0 * step)
    assert np.abs(found.tie_forces[1:-1, 0] - rate).max() < 0.03 * np.abs(rate).max()


def on_these_ranks(path):
    one = space(mesh("tetrahedron", (2, 2, 1), place=below), 2)
    dofs = dolfinx.fem.locate_dofs_topological(one, 2, faces(one.mesh, -1.0))
    push = ufl.inner(dolfinx.fem.Constant(one.mesh, np.array([0.1, 0.0, 0.0])), ufl.TestFunction(one)) * ufl.dx
    block = Solid(one, LAW, 1.5, [dolfinx.fem.dirichletbc(np.array([0.0, 0.02, 0.0]), dofs, one)], push)
    rod = post(elements=2)
    tie = Tie(EndFace(0, "start"), SolidSurface(0, faces(one.mesh, 0.0)))
    model = Model(
        [Body(rod, LAW, 2.0)], loads=[SectionLoad.end(rod, "end", (0.1, 0.1, 0.0))], ties=[tie], solids=[block]
    )
    velocity = np.cross([0.05, 0.0, 0.1], rod.positions).ravel()
    found = dynamics.solve(model, 0.5, 0.25, outputs=2, integrator="implicit", velocity=velocity, damping=0.05)
    last = found[-1]
    own = np.column_stack([one.reshape(-1, 3) for one in (block.positions, *last.solids, *last.solid_velocities)])
    rows = np.concatenate(MPI.COMM_WORLD.allgather(own))
    if MPI.COMM_WORLD.rank == 0:
        names = "displacement velocity kinetic stored load_work dissipated tie_forces tie_moments".split()
        rows = rows[np.lexsort(np.round(rows[:, :3], 6).T)]
        np.savez(path, rows=rows, **{name: getattr(found, name) for name in names})


def test_two_ranks_move_as_one(on_ranks, tmp_path):
    on_these_ranks(tmp_path / "one.npz")
    on_ranks(2, f"test_solid_motion.on_these_ranks({str(tmp_path / 'two.npz')!r})")
    one, two = (np.load(tmp_path / f"{name}.npz") for name in ("one", "two"))
    for name in one:
        assert np.abs(two[name] - one[name]).max() < 1e-9 * np.abs(one[name]).max(), name


MOTION = SCENE.replace(
    'analysis = "statics"',
    '[analysis.dynamics]\nend_time = 2.0\ntime_step = 0.25\noutputs = 4\nintegrator = "implicit"',
).replace('[measure.force]\ntie_force = "weld"\n', "")
LOADED = "[load.push]\nend = 'end'\nforce = [1e-3, 0.0, 0.0]\n"


def in_file(tmp_path, *changes, more=LOADED):
    path = tmp_path / "my.toml"
    path.write_text(MOTION + more)
    (tmp_path / "block.msh").write_bytes(content(*box()))
    return FileScene(str(path), changes=changes)


def test_a_file_moves_a_rod_on_a_block(tmp_path):
    scene = in_file(tmp_path, "solid.block.held=bottom", "solid.block.density=1.0")
    found = dynamics.solve(scene.model(), **scene.settings())
    tip = np.array(scene.measure(found)["tip"])
    at_rest = statics.solve(scene.model()).at(0, "end")
    # Let go from rest under a load that stays it swings about the equilibrium, to twice as far.
    assert tip[0] == pytest.approx(np.zeros(3))
    assert 0.0 < tip[:, 0].max() < 2.3 * at_rest[0]
    assert np.abs(found.energy_error).max() < 1e-9


def motion_of(*changes):
    def run(tmp_path):
        scene = in_file(tmp_path, *changes, more="")
        with scene.locating():
            dynamics.solve(scene.model(), **scene.settings())

    return run


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ((), "solid block has density 0, dynamics needs a positive mass per volume"),
        (
            ("solid.block.density=1", "analysis.dynamics.integrator=explicit"),
            "solids: not supported by explicit steps; use integrator 'implicit'",
        ),
    ],
)
def test_a_file_is_told_what_cannot_move(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message) as caught:
        motion_of(*changes)(tmp_path)
    assert "my.toml:" in str(caught.value) and "\n" not in str(caught.value)


def started(*given):
    return lambda: dynamics.solve(
        on_block(counts=(1, 1, 1), degree=1, held=True)[0], 1.0, 0.5, integrator="implicit", solids=list(given)
    )


test_bad_starts = refused(
    (started((0.0, 0.0), (0.0, 0.0)), "initial state of solids: got 2 pairs, need one for each of 1"),
    (started((np.zeros(5), 0.0)), r"initial displacement of solid 0: got shape \(5,\), need \(24,\) or \(3,\)"),
    (started((0.0, (0.0, np.nan, 0.0))), "initial velocity of solid 0"),
)
