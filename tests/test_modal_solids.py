"""Modes of rods with finite element bodies: shapes of these, what they are written as, errors of frequencies."""

import json
from functools import cache

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import solids
from conftest import straight
from dolfinx import fem, mesh
from mpi4py import MPI
from msh import box, content

from isorod import LinearElastic, NeoHookean, SectionLoad, Space, modal
from isorod.assembly.formulation import assembler_for
from isorod.checks.estimate_of_modes import of_solids
from isorod.command.cli import main
from isorod.fenics.solid import Solid
from isorod.model import Body, Model
from isorod.model.tie import EndFace, SolidSurface, Tie

LAW, SOFT = NeoHookean(200.0, 0.3), NeoHookean(20.0, 0.3)
MODES = 3


def held(space):
    """Return what holds the bottom of a block."""
    facets = mesh.locate_entities_boundary(space.mesh, 2, lambda x: x[2] < -1.0 + 1e-9)
    return fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(space, 2, facets), space)


def mast(shape, count, degree, law=LAW, finer=0, **more):
    """Return a rod of radius 0.2 and length 1 on a block whose bottom is held, of so many cells in each direction."""
    domain = solids.mesh(shape, (count, count + 1, count), 1, lambda points: points - [0.5, 0.5, 1.0])
    space = solids.space(domain, degree)
    block = Solid(space, law, 1.0, [held(space)])
    top = mesh.locate_entities_boundary(domain, 2, lambda x: x[2] > -1e-9)
    rod = Space(straight(8, radius=0.2, height=1.0), section_degree=4 + finer, degree=5 + bool(finer))
    tie = Tie(EndFace(0, "start"), SolidSurface(0, top))
    return Model([Body(rod, LAW, 1.0)], ties=[tie], solids=[block], **more)


PULL = {"loads": [SectionLoad((0.0, 0.0, 1.0))]}


@cache
def finest(law, loads):
    return modal.solve(mast("hexahedron", 5, 2, law, 2, **(PULL if loads else {})), MODES)


def test_shapes_are_of_unit_mass_and_balance_the_forces_of_the_body():
    model = mast("tetrahedron", 3, 1)
    modes = modal.solve(model, MODES)
    (block,), (shapes,) = model.solids, modes.solids
    stiffness = block.tangent(np.zeros(3 * block.nodes), 0.0)
    free = np.repeat(block.positions[:, 2] < -1e-9, 3)
    free[block.held[0]] = False
    rods = assembler_for(Model(model.bodies))
    mass = rods.mass()
    for value, shape, vector in zip(modes.eigenvalues, shapes, modes.vectors, strict=True):
        pulled, heavy = solids.times(stiffness, shape), value * block.momenta(shape)
        # What a tie moves has forces of its own.
        assert np.abs(pulled - heavy)[free].max() < 1e-6 * np.abs(heavy).max()
        moved = rods.state(vector)
        assert moved.dot(mass * moved) + shape @ block.momenta(shape) == pytest.approx(1.0, rel=1e-9)
    assert modes[1].function().x.array == pytest.approx(shapes[1])


@pytest.mark.parametrize(
    ("shape", "count", "degree", "law"),
    [
        ("tetrahedron", 3, 1, SOFT),
        ("tetrahedron", 6, 1, LAW),
        ("hexahedron", 4, 1, LAW),
        ("tetrahedron", 2, 2, LAW),
        ("hexahedron", 2, 2, SOFT),
    ],
)
def test_estimates_are_errors(shape, count, degree, law):
    """Within a factor of three, of the largest error of three frequencies, beside a much finer mesh."""
    modes, exact = modal.solve(mast(shape, count, degree, law), MODES), finest(law, False)
    error = np.abs(modes.frequencies / exact.frequencies - 1.0).max()
    assert error / 3.0 < modes.estimate() < 3.0 * error
    assert (np.abs(modes.coarsest - [0.0, 0.0, -0.5]) < 0.5).all()


def test_estimates_about_a_state_are_errors():
    modes, exact = modal.solve(mast("tetrahedron", 3, 2, SOFT, **PULL), MODES), finest(SOFT, True)
    error = np.abs(modes.frequencies / exact.frequencies - 1.0).max()
    assert np.abs(exact.frequencies / finest(SOFT, False).frequencies - 1.0).max() > 0.02
    assert error / 3.0 < modes.estimate() < 3.0 * error


def test_estimates_do_not_depend_on_units_of_mass():
    """Shapes of unit mass may be of any size."""
    heavy, light = (mast("tetrahedron", 3, 1) for _ in range(2))
    light = Model([Body(light.bodies[0].space, LAW, 1e-12)], ties=light.ties, solids=light.solids)
    light.solids[0].density = 1e-12
    one, other = (modal.solve(model, MODES) for model in (heavy, light))
    assert one.frequencies == pytest.approx(1e-6 * other.frequencies, rel=1e-6)
    assert one.estimate() == pytest.approx(other.estimate(), rel=1e-4)


def test_a_body_given_as_a_form_has_no_estimate():
    import ufl

    model = mast("tetrahedron", 2, 1)
    (block,) = model.solids
    u = fem.Function(block.space)
    form = 100.0 * ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(ufl.TestFunction(block.space))) * ufl.dx
    unknown = Solid(block.space, density=1.0, conditions=block.conditions, form=form, unknown=u)
    modes = modal.solve(Model(model.bodies, ties=model.ties, solids=[unknown]), MODES)
    assert modes.estimate() is None and modes.coarsest is None


def test_a_linear_body_has_the_estimate_of_its_tangent():
    """Of a law whose tangent at rest is the same."""
    errors = []
    for law in (LAW, LinearElastic(200.0, 0.3)):
        modes = modal.solve(mast("tetrahedron", 3, 1, law), MODES)
        errors.append(of_solids(modes.model, modes.eigenvalues, modes.solids)[0])
    assert errors[0] == pytest.approx(errors[1], rel=1e-4)


def told():
    modes = modal.solve(mast("tetrahedron", 3, 1), MODES)
    sizes = [float(solids.gathered(MPI.COMM_WORLD, np.abs(one)).max()) for one in modes.solids[0]]
    return [*modes.frequencies.tolist(), modes.estimate(), *sizes, *modes.coarsest.tolist()]


def same(expected):
    assert told() == pytest.approx(expected, rel=1e-6)


@pytest.mark.mpi
def test_ranks_agree(on_ranks):
    on_ranks(2, f"test_modal_solids.same({told()!r})")


SCENE = """
[rod.mast]
curve = {straight = 1.0}
section = {circle = 0.2}
law = {NeoHookean = {E = 200.0, nu = 0.3}}
density = 1.0

[solid.block]
mesh = "block.msh"
law = {NeoHookean = {E = 20.0, nu = 0.3}}
density = 1.0
held = "bottom"

[tie.foot]
slave = "mast.start"
master = "block.top"

[analysis.modal]
modes = 2
"""


@pytest.mark.parametrize("load", ["", "[load.pull]\nend = 'end'\nforce = [0.0, 0.0, 3.0]\n"])
def test_files_say_the_error_and_write_the_shapes_of_bodies(load, tmp_path, capsys):
    pyvista = pytest.importorskip("pyvista")
    (tmp_path / "mast.toml").write_text(SCENE + load)
    (tmp_path / "block.msh").write_bytes(content(*box((1.0, 1.0, 1.0), (3, 3, 3), (-0.5, -0.5, -1.0))))
    assert main(["run", str(tmp_path / "mast.toml"), "--json", "--output", str(tmp_path / "found")]) == 0
    out, err = capsys.readouterr()
    record = json.loads(out)
    assert record["error_estimate"] > 0.005
    assert "isorod: warning: estimated error " in err and "or the mesh, first of all near (" in err
    block = pyvista.read(tmp_path / "found" / record["files"][1])
    rest = {"displacement", "von_mises"} if load else set()
    assert set(block.point_data) == {"mode_1", "mode_2"} | rest
    mast = pyvista.read(tmp_path / "found" / record["files"][0])
    foot = np.linalg.norm(mast.points, axis=1).argmin()
    below = np.linalg.norm(block.points, axis=1).argmin()
    moved = np.linalg.norm(mast["mode_1"], axis=1).max()
    assert np.linalg.norm(block["mode_1"][below] - mast["mode_1"][foot]) < 0.03 * moved
