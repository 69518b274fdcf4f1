"""Modes about equilibria in which rods press on finite element bodies: tangents, a spring, a tied shaft, ranks."""

import json
import re

import numpy as np
import pytest
from scipy.sparse import coo_matrix

pytest.importorskip("dolfinx")

from conftest import straight
from dolfinx import fem
from msh import BAR_ON_BOX, box, content
from surfaces import FIT, OUTER
from test_contact_solid import block, lying
from test_contact_solid_motion import heavy
from touching import ACROSS, moved

from comparisons.joints.lattice import circle, ring
from comparisons.joints.sleeve import pinned
from isorod import InputError, LinearElastic, NeoHookean, Space, modal, statics
from isorod.assembly.formulation import assembler_for
from isorod.command.cli import main
from isorod.contact.frozen import Frozen
from isorod.fenics import compat
from isorod.fenics.solid import Solid
from isorod.modal import touching
from isorod.model import Body, BodyForce, Contact, Model, Support
from isorod.model.tie import LateralSurface, SolidSurface, Tie

UNSURE = "ignore:compliance of contact patches"
UNSEEN = "ignore:contact 0. contact patch under-resolved"


def dense(contact, count):
    return coo_matrix((contact.values, (contact.rows, contact.columns)), shape=(count, count)).toarray()


@pytest.mark.parametrize(("shape", "degree"), [("hexahedron", 1), ("hexahedron", 2), ("tetrahedron", 2)])
def test_frozen_contact_has_the_tangent_of_contact_but_for_its_depth(shape, degree):
    """What it neglects is the penetration over the radius, which is as much less as the penalty is stiffer."""
    errors = []
    for penalty in (20.0, 200.0):
        model = heavy(lying(shape, degree, push=0.02, penalty=penalty, points=(12, 12)))
        state = statics.solve(model, petsc={"snes_rtol": 1e-12})
        assembler = assembler_for(model)
        about = assembler.touching(assembler.state(state.displacement, (), state.solids), 1.0)
        operator = assembler.contact
        operator.tangent(about)
        frozen = Frozen(model, model.contacts, state.contacts, about, assembler.comm)
        exact, found = dense(operator, about.size), dense(frozen, about.size)
        assert operator.beyond.size and frozen.beyond.size == operator.beyond.size
        assert np.abs(found - found.T).max() < 1e-12 * np.abs(found).max()
        errors.append(np.abs(found - exact).max() / np.abs(exact).max())
        assert frozen.forces(about)[0] == pytest.approx(operator.forces(about)[0], abs=1e-12)
    assert errors[0] < 2e-3
    assert errors[1] < 0.3 * errors[0]


@pytest.mark.filterwarnings(UNSURE)
def test_the_tangent_of_modes_is_the_derivative_of_the_residual(monkeypatch):
    model = heavy(lying(push=0.02, penalty=200.0, points=(12, 12)))
    state = statics.solve(model, petsc={"snes_rtol": 1e-12})
    monkeypatch.setattr(
        touching, "Frozen", lambda *given, **how: Frozen(*given, **how | {"tight": False}), raising=True
    )
    held, free = assembler_for(model), assembler_for(model)
    assert touching.hold(held, state) == []
    x, way = (held.state(state.displacement, (), state.solids) for _ in range(2))
    way.array_w[:] = np.random.default_rng(2).standard_normal(way.local_size)
    matrix, forces = held.matrix(), [free.vector() for _ in range(2)]
    held.tangent(x, 1.0, matrix)
    for sign, force in zip((1.0, -1.0), forces, strict=True):
        free.residual(x + sign * 1e-7 * way, 1.0, force)
    difference = (forces[0] - forces[1]) * (1.0 / 2e-7)
    assert (difference - matrix * way).norm() < 1e-3 * difference.norm()


def resting(weight, penalty=None, points=None):
    """Return a stiff bar that its weight presses on a light block, and that goes up and down alone."""
    solid, top = block("hexahedron", 2, (4, 4, 2), NeoHookean(10.0, 0.3))
    solid.density = 1e-6
    rod = moved(straight(8, radius=0.4, height=2.4), (-1.2, 0.0, 0.4), ACROSS)
    space = Space(rod, order=2, section_points=16, elements=2, degree=3)
    contact = Contact(0, SolidSurface(0, top), penalty, points=points)
    return Model(
        [Body(space, NeoHookean(1e4, 0.3), 1.0)],
        [Support(np.arange(space.nodes), "xy")],
        loads=[BodyForce((0.0, 0.0, -weight))],
        contacts=[contact],
        solids=[solid],
    )


@pytest.mark.filterwarnings(UNSURE)
@pytest.mark.filterwarnings(UNSEEN)
@pytest.mark.parametrize(("given", "least", "most"), [((), 0.0, 0.03), ((40.0, (16, 16)), 0.1, 0.3)])
def test_a_heavy_bar_on_an_elastic_block_is_a_mass_on_a_spring(given, least, most):
    """The spring is the slope of force over way in statics; how far modes are off is less than what they say it is."""
    weight, lengths = 1.0, []
    for factor in (0.99, 1.01):
        model = resting(factor * weight, *given)
        space, state = model.bodies[0].space, statics.solve(model, petsc={"snes_rtol": 1e-12})
        lengths.append(state.displacement.reshape(-1, 3)[space.is_control_point, 2].mean())
    exact = np.sqrt(0.02 * weight / (lengths[0] - lengths[1])) / (2.0 * np.pi)
    modes = modal.solve(resting(weight, *given), 2)
    assert modes.rigid == 0 and modes.frequencies[1] > 10.0 * modes.frequencies[0]
    softer = 1.0 - exact / modes.frequencies[0]
    assert least < softer < modes.contact_error() < most
    assert modes.contacts[0].on_facets and "points in contact" in modes.about


def shaft_in_hub(kind="", friction=0.0, around=32):
    """Return a shaft that is held at one end in a hub, to which it is tied, or on which it presses."""
    made = ring(FIT, circle(OUTER), 10.0, (2, around, 1), "hexahedron", 2)
    whole = compat.function_space(made.mesh, compat.element(made.mesh, "Lagrange", 2, 3))
    part = whole.sub(2)
    own, _ = compat.collapsed(part)
    face = fem.locate_dofs_geometrical((part, own), lambda x: np.abs(x[2]) < 1e-9)
    conditions = [*pinned(whole, OUTER), fem.dirichletbc(fem.Function(own), face, part)]
    hub, hole = Solid(whole, NeoHookean(70e3, 0.33), 1.0, conditions), SolidSurface(0, made.hole)
    rod = straight(8, radius=FIT + (0.0 if kind else 1e-3), height=10.0)
    shaft = Space(rod, order=2, elements=1, degree=3)
    more = {"contacts": [Contact(0, hole, friction=friction)]}
    if kind:
        more = {"ties": [Tie(LateralSurface(0), hole, kind=kind, gap=0.1)]}
    body = Body(shaft, NeoHookean(210e3, 0.3), 1.0)
    return Model([body], [Support.end(shaft, "start")], solids=[hub], **more)


@pytest.mark.parametrize(("kind", "friction", "near"), [("slide", 0.0, 3e-3), ("weld", 20.0, 0.012)])
def test_a_shaft_that_presses_all_round_vibrates_as_one_that_is_tied(kind, friction, near):
    """Of more layers of bricks and elements five times nearer, 0.04 %; one that sticks gives way as its springs do."""
    tied = modal.solve(shaft_in_hub(kind), 6)
    with pytest.warns(UserWarning, match=r"compliance of contact patches may change frequencies by up to \d.\d %"):
        pressed = modal.solve(shaft_in_hub(friction=friction), 6)
    assert (pressed.contacts[0].pressure > 0.0).all()
    assert pressed.contacts[0].slipping == 0
    assert pressed.frequencies == pytest.approx(tied.frequencies, rel=near)
    assert np.abs(pressed.frequencies / tied.frequencies - 1.0).max() < pressed.contact_error()
    apart = modal.solve(Model(tied.model.bodies, tied.model.supports, solids=tied.model.solids), 1)
    assert abs(apart.frequencies[0] / tied.frequencies[0] - 1.0) > 0.1


def frequencies():
    model = heavy(lying(push=0.02, penalty=200.0, points=(12, 12)))
    return modal.solve(model, 3, petsc={"eps_tol": 1e-12, "snes_rtol": 1e-12}).frequencies


def same(expected):
    assert frequencies() == pytest.approx(np.array(expected), rel=1e-8)


@pytest.mark.mpi
@pytest.mark.filterwarnings(UNSURE)
def test_ranks_agree(on_ranks):
    on_ranks(2, f"test_contact_solid_modes.same({frequencies().tolist()!r})")


def test_what_is_not_known_is_refused():
    model = lying(push=0.02)
    model.solids[0].density = 1.0
    bodies = [Body(model.bodies[0].space, model.bodies[0].laws[0], 1.0)]
    # A round bar that nothing else holds rolls.
    weight, contact = BodyForce((0.0, 0.0, -0.1)), lying(penalty=20.0, points=(12, 12)).contacts[0]
    free = Model(bodies, loads=[weight], contacts=[contact], solids=model.solids)
    with pytest.raises(InputError, match=r"body 0 is free to .* but for the width of contact patches"):
        modal.solve(free, 2)
    linear = Solid(model.solids[0].space, LinearElastic(1.0, 0.3), 1.0, model.solids[0].conditions)
    with pytest.raises(InputError, match="equilibrium: solid 0 is linear elastic, without geometric stiffness"):
        modal.solve(Model(bodies, model.supports, contacts=model.contacts, solids=[linear]), 2)


SCENE = f"""
analysis = {{modal = {{modes = 2}}}}
{BAR_ON_BOX}
[support.start]
end = "start"
[support.end]
end = "end"
"""


def test_a_file_has_modes_of_a_bar_that_presses_on_a_block(tmp_path, capsys):
    (tmp_path / "block.msh").write_bytes(content(*box(bricks=True)))
    path, found = tmp_path / "press.toml", []
    for height in ("0.29", "0.31"):
        path.write_text(SCENE.replace("0.29", height))
        assert main(["run", str(path), "--json"]) == 0
        out, err = capsys.readouterr()
        found.append(json.loads(out))
        assert ("compliance of contact patches" in err) == (height == "0.29")
    pressed, apart = found
    assert re.match(r"the equilibrium under 1 contact with \d+ points in contact", pressed["about"])
    assert apart["about"] == "the equilibrium under 1 contact with no point in contact"
    assert pressed["frequencies"][0] > 1.02 * apart["frequencies"][0]
