"""Rods that touch finite element bodies in implicit motion: impact, rest, friction, balances, ranks, files."""

import json

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

pytest.importorskip("dolfinx")

import solids
from conftest import straight
from dolfinx import mesh
from msh import BAR_ON_BOX, box, content
from test_contact_solid import SOFT, block, fitted, lying
from touching import ACROSS, moved

from isorod import NeoHookean, SolveError, Space, dynamics, statics
from isorod.command.cli import main
from isorod.dynamics.implicit.assembler import StepAssembler
from isorod.fenics.solid import Solid
from isorod.model import Body, BodyForce, Contact, Model, Support
from isorod.model.tie import SolidSurface

STIFF = NeoHookean(1e4, 0.3)
RADIUS, LENGTH, PENALTY = 0.4, 2.4, 10.0


def flying(law=STIFF, height=0.01, shape="hexahedron", penalty=PENALTY, density=0.3, **more):
    """Return a bar over a block from (-1, -1, -1) to (1, 1, 0), longer than that, neither held."""
    place = solids.mesh(shape, (2, 2, 1), 1, lambda points: points * [2.0, 2.0, 1.0] - 1.0)
    top = mesh.locate_entities_boundary(place, 2, lambda x: x[2] > -1e-9)
    solid = Solid(solids.space(place, 1), law, density)
    rod = moved(straight(8, radius=RADIUS, height=LENGTH), (-0.5 * LENGTH, 0.0, RADIUS + height), ACROSS)
    space = Space(rod, order=2, section_points=8, elements=2, degree=3)
    contact = Contact(0, SolidSurface(0, top), penalty, **more)
    return Model([Body(space, law, 1.0)], contacts=[contact], solids=[solid])


def thrown(model, ahead, spin=(0.0, 0.0, 0.0)):
    """Return the initial velocity of a bar, and of a body that turns with it."""
    space, (solid,) = model.bodies[0].space, model.solids
    turning = np.cross(spin, space.positions) + space.is_control_point[:, None] * np.array(ahead)
    return {"velocity": turning.ravel(), "solids": [(0.0, np.cross(spin, solid.positions).ravel())]}


def means(history):
    """Return the mean velocity of a bar and of a body at outputs."""
    carries = history.model.bodies[0].space.is_control_point
    rods, others = (one.reshape(len(history), -1, 3) for one in (history.velocity, history.solid_velocity))
    return rods[:, carries].mean(axis=1), others.mean(axis=1)


def resisted(depth, upwards=True):
    """Return the force of a rigid cylinder that is so deep in a plane of springs, or the integral of the pressure."""
    if depth <= 0.0:
        return 0.0
    below = RADIUS - depth
    half = np.sqrt(RADIUS**2 - below**2)

    def pressure(y):
        return PENALTY * (RADIUS - np.hypot(y, below)) * (below / np.hypot(y, below) if upwards else 1.0)

    return 4.0 * quad(pressure, 0.0, half)[0]


@pytest.mark.parametrize("shape", [pytest.param("tetrahedron", marks=pytest.mark.slow), "hexahedron"])
def test_a_bar_that_falls_on_a_block_as_heavy_gives_it_its_velocity(shape):
    """Both are as good as rigid: two masses and a spring between them, whose force is known."""
    fast, masses = 0.1, (np.pi * RADIUS**2 * LENGTH, 4.0 * 0.3)
    reduced = masses[0] * masses[1] / sum(masses)
    exact = solve_ivp(
        lambda _, y: [y[1], -resisted(y[0]) / reduced], (0.0, 1.6), [-0.01, fast], rtol=1e-8, atol=1e-10, max_step=0.05
    )
    pressed = exact.t[exact.y[0] > 0.0]
    assert 1.1 < pressed[-1] - pressed[0] < 1.3
    model = flying(shape=shape)
    found = dynamics.solve(model, 1.6, 0.04, outputs=40, integrator="implicit", **thrown(model, (0.0, 0.0, -fast)))
    relative = np.interp(found.times, exact.t, exact.y[1])
    centre = fast * masses[0] / sum(masses)
    rod, other = means(found)
    assert rod[:, 2] == pytest.approx(-centre - relative * masses[1] / sum(masses), abs=8e-3 * fast)
    assert other[:, 2] == pytest.approx(-centre + relative * masses[0] / sum(masses), abs=8e-3 * fast)
    # They have exchanged their velocities.
    assert other[-1, 2] == pytest.approx(-fast, rel=8e-3)
    deepest = exact.y[0].max()
    assert found.penetration.max() == pytest.approx(deepest, rel=0.03)
    assert found.contact_force.max() == pytest.approx(resisted(deepest, False), rel=0.02)
    assert found.momentum_error.max() < 1e-12
    assert np.abs(found.energy_error).max() < 2e-3


def test_energy_errs_by_the_square_of_the_step_and_both_momenta_do_not():
    model, errors = flying(NeoHookean(30.0, 0.3)), []
    heavy = StepAssembler(model)
    rest = np.concatenate([model.bodies[0].space.positions, model.solids[0].positions])
    carries = np.append(model.bodies[0].space.is_control_point, np.ones(model.solids[0].nodes))
    for steps in (20, 40, 80):
        given = thrown(model, (0.02, 0.03, -0.1), (0.1, 0.2, -0.1))
        found = dynamics.solve(model, 1.6, 1.6 / steps, outputs=8, integrator="implicit", **given)
        assert found.contact_force.max() > 0.05 and found.contact_force[-1] == 0.0
        errors.append(np.abs(found.energy_error).max())
        momenta, places = [], []
        for rods, others, moved_rods, moved_others in zip(
            found.velocity, found.solid_velocity, found.displacement, found.solid_displacement, strict=True
        ):
            momenta.append(heavy.momenta(np.append(rods, others)).reshape(-1, 3))
            places.append(rest + np.append(moved_rods, moved_others).reshape(-1, 3))
        whole = np.array([carries @ one for one in momenta])
        turning = np.array([np.cross(x, p).sum(axis=0) for x, p in zip(places, momenta, strict=True)])
        # Points are projected to the eighth digit.
        for one, lost in ((whole, 1e-12), (turning, 1e-7)):
            assert np.abs(one - one[0]).max() < lost * np.abs(one).max()
        assert found.momentum_error.max() < 1e-12
    assert errors[2] < 0.4 * errors[1] < 0.2 * errors[0]


def test_an_incompressible_bar_bounces_off_a_block():
    model = flying(NeoHookean(30.0, 0.3))
    bodies = [Body(model.bodies[0].space, NeoHookean(30.0, 0.5), 1.0)]
    model = Model(bodies, contacts=model.contacts, solids=model.solids)
    found = dynamics.solve(model, 1.6, 0.04, outputs=8, integrator="implicit", **thrown(model, (0.0, 0.0, -0.1)))
    assert found.contact_force.max() > 0.1 and found.contact_force[-1] == 0.0
    assert means(found)[1][-1, 2] < -0.09
    assert found.pressure.any()
    assert np.abs(found.energy_error).max() < 3e-3
    assert found.momentum_error.max() < 1e-12


def heavy(model, density=2.0):
    """Return a model with densities, on the spaces of motion."""
    model.solids[0].density = 1.0
    bodies = [Body(body.space, body.laws[0], density) for body in model.bodies]
    return Model(bodies, model.supports, contacts=model.contacts, solids=model.solids).in_motion("implicit")


@pytest.mark.parametrize("shape", solids.SHAPES)
def test_what_is_in_equilibrium_in_statics_stays_so(shape):
    model = heavy(lying(shape, penalty=20.0, points=(12, 12)))
    rest = statics.solve(model, petsc={"snes_rtol": 1e-13})
    found = dynamics.solve(
        model,
        2.0,
        0.5,
        outputs=4,
        integrator="implicit",
        displacement=rest.displacement,
        solids=[(rest.solids[0], 0.0)],
    )
    assert np.abs(found.displacement - rest.displacement).max() < 1e-10
    assert np.abs(found.solid_displacement - rest.solids[0]).max() < 1e-10
    assert found.contact_force == pytest.approx(np.full(5, rest.contacts[0].force), abs=1e-10)
    # What supports and the body are held by, by the balance at an instant.
    assert found.reactions[-1] == pytest.approx(rest.reactions, abs=1e-9)
    assert found.momentum_error.max() < 1e-10


def stacked(model):
    """Return a model with a hollow bar by polynomials on its bar, which it touches too."""
    rod = moved(straight(8, radius=0.3, height=2.0), (-1.0, 0.0, 1.02), ACROSS).with_rings((0.5, 1.0))
    upper = Body(Space(rod, section_degree=3, elements=1, degree=2), SOFT, 1.0)
    contacts = [*model.contacts, Contact(0, 1, 30.0)]
    return Model([*model.bodies, upper], model.supports, contacts=contacts, solids=model.solids).in_motion("implicit")


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize(("shape", "degree", "several"), [("hexahedron", 1, True), ("tetrahedron", 2, False)])
def test_the_tangent_of_a_step_is_the_derivative_of_its_balance(shape, degree, several, friction):
    model = heavy(lying(shape, degree, push=0.0, height=-0.04, friction=friction, penalty=40.0))
    model = stacked(model) if several else model
    assembler, rng = StepAssembler(model), np.random.default_rng(5)
    count = model.dofs + 3 * model.solids[0].nodes
    start, ahead = 1e-3 * rng.standard_normal((2, count))
    start[model.held] = ahead[model.held] = 0.0
    if friction:
        assembler.contact.accept(0.0 * assembler.contact_displacement(start))
    assembler.begin(0.1, 0.05, start, ahead)
    x, way, matrix = assembler.vector(), assembler.vector(), assembler.matrix()
    x.array_w[:] = 2e-3 * rng.standard_normal(x.local_size)
    way.array_w[:] = rng.standard_normal(x.local_size)
    assembler.tangent(x, 1.0, matrix)
    assert assembler.contact.touching > 20
    assert all(one.active for one in assembler.contact.results(assembler.contact_displacement(0.0 * start)))
    forces = [assembler.vector() for _ in range(2)]
    for sign, force in zip((1.0, -1.0), forces, strict=True):
        assembler.residual(x + sign * 1e-7 * way, 1.0, force)
    difference = (forces[0] - forces[1]) * (1.0 / 2e-7)
    assert (difference - matrix * way).norm() < 1e-5 * difference.norm()


def sliding(friction, held=False):
    """Return a stiff bar that lies on a stiff block with its weight."""
    solid, top = block("hexahedron", 1, (2, 2, 1), STIFF)
    solid.density = 1.0
    rod = moved(straight(8, radius=RADIUS, height=2.8), (-1.5, 0.0, RADIUS), ACROSS)
    space = Space(rod, order=1, elements=1, degree=2, quadrature="full")
    supports = [Support(np.arange(space.nodes), "xy")] if held else []
    contact = Contact(0, SolidSurface(0, top), 400.0, friction=friction, points=(20, 20))
    weight = BodyForce((0.0, 0.0, -0.5))
    return Model([Body(space, STIFF, 1.0)], supports, loads=[weight], contacts=[contact], solids=[solid])


def slid(friction, time, steps, **more):
    """Return the motion of such a bar that slides along its axis."""
    rest, model = statics.solve(sliding(0.0, held=True)), sliding(friction)
    space = model.bodies[0].space
    return dynamics.solve(
        model,
        time,
        time / steps,
        integrator="implicit",
        displacement=rest.displacement,
        velocity=(space.is_control_point[:, None] * np.array([0.15, 0.0, 0.0])).ravel(),
        solids=[(rest.solids[0], 0.0)],
        **({"outputs": 10} | more),
    )


def test_friction_stops_what_slides():
    """By ``mu g``, after ``v / (mu g)``; what it moves with is heat then."""
    rate = 0.2 * 0.5
    found = slid(0.2, 1.8, 72, outputs=12)
    rod = means(found)[0][:, 0]
    assert rod[:10] == pytest.approx(0.15 - rate * found.times[:10], abs=0.02 * 0.15)
    assert np.abs(rod[-1]) < 0.1 * 0.15
    space = found.model.bodies[0].space
    gone = found.displacement[-1].reshape(-1, 3)[space.is_control_point, 0].mean()
    assert gone == pytest.approx(0.15**2 / (2.0 * rate), rel=0.02)
    assert found.dissipated[-1] == pytest.approx(found.kinetic[0], rel=0.02)
    assert np.abs(found.energy_error).max() < 2e-3
    assert found.momentum_error.max() < 1e-11


def test_a_resumed_run_is_that_which_was_not_stopped(tmp_path):
    whole = slid(0.2, 0.4, 16, outputs=4)
    kept = {"checkpoint": tmp_path / "state"}
    slid(0.2, 0.2, 8, outputs=2, **kept)
    on = slid(0.2, 0.4, 16, outputs=4, resume=True, **kept)
    for name in ("displacement", "solid_velocity", "contact_energy", "dissipated", "energy_error"):
        assert np.array_equal(getattr(on, name), getattr(whole, name)), name


def test_what_would_go_through_facets_is_refused():
    model = flying(NeoHookean(30.0, 0.3), height=0.5)
    with pytest.raises(SolveError, match=r"tunnelling of body 0 at u = .* through the facets of contact 0; increase"):
        dynamics.solve(model, 1.0, 1.0, outputs=1, integrator="implicit", **thrown(model, (0.0, 0.0, -2.0)))
    with pytest.raises(SolveError, match=r"contact 0: penetration is .* of the smaller radius before the step"):
        model = flying(height=-0.3)
        dynamics.solve(model, 1.0, 0.1, outputs=1, integrator="implicit", **thrown(model, (0.0, 0.0, 0.0)))


def test_flat_facets_in_a_round_hole_are_warned_of_as_in_statics():
    model = heavy(fitted(24, degree=1))
    with pytest.warns(UserWarning, match=r"contact 0: facets are flat, up to 0.08\d from a smooth surface"):
        dynamics.solve(model, 0.01, 0.005, outputs=1, integrator="implicit")


def on_these_ranks(path):
    found = slid(0.2, 0.3, 6, outputs=2)
    names = "displacement velocity reactions contact_force contact_energy penetration kinetic stored dissipated"
    np.savez(path, **{name: getattr(found, name) for name in names.split()})


@pytest.mark.mpi
def test_two_ranks_move_as_one(on_ranks, tmp_path):
    on_these_ranks(tmp_path / "one.npz")
    on_ranks(2, f"test_contact_solid_motion.on_these_ranks({str(tmp_path / 'two.npz')!r})")
    one, two = (np.load(tmp_path / f"{name}.npz") for name in ("one", "two"))
    for name in one.files:
        assert two[name] == pytest.approx(one[name], rel=1e-9, abs=1e-12), name


SCENE = f"""
analysis = {{dynamics = {{end_time = 1.0, time_step = 0.05, outputs = 5, integrator = "implicit"}}}}
{BAR_ON_BOX.replace("0.29", "0.31")}
friction = 0.2
[load.weight]
body_force = [0.0, 0.0, -0.1]
"""


def test_a_file_has_a_bar_that_bounces_off_a_block(tmp_path, capsys):
    (tmp_path / "block.msh").write_bytes(content(*box(bricks=True)))
    path = tmp_path / "bounce.toml"
    path.write_text(SCENE)
    assert main(["run", str(path), "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert max(record["contact_force"]) > 0.0
    assert max(record["momentum_error"]) < 1e-9
