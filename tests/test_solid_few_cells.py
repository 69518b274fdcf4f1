"""Finite element bodies of fewer cells than ranks: ranks without any give the same answers."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
import dolfinx.fem
import solids

import isorod
from isorod import dynamics, modal, statics
from isorod.fenics.solid import Solid

LAW = isorod.NeoHookean(1.0, 0.3)


def answers(shape, counts, degree):
    """Return numbers of statics, modes and motion of a rod on a block of a few cells, and of the block alone."""
    domain = solids.mesh(shape, counts, 1, lambda points: points * [4.0, 4.0, 2.0] - [2.0, 2.0, 0.0])
    space = solids.space(domain, degree)
    bottom, top = (solids.where(domain, lambda x, z=z: np.isclose(x[2], z)) for z in (0.0, 2.0))
    dofs = dolfinx.fem.locate_dofs_topological(space, 2, bottom)
    block = Solid(space, LAW, 1.0, [dolfinx.fem.dirichletbc(np.zeros(3), dofs, space)])
    rod = isorod.Space(isorod.straight(4.0, start=(0.0, 0.0, 2.0)).sweep(isorod.circle(8)), elements=1, degree=3)
    tie = isorod.Tie(isorod.EndFace(0, "start"), isorod.SolidSurface(0, top))
    load = isorod.SectionLoad.end(rod, "end", (0.01, 0.0, 0.02))
    model = isorod.Model([isorod.Body(rod, LAW, 1.0)], loads=[load], ties=[tie], solids=[block])
    solution = statics.solve(model)
    work = block.recovered(solution.solids[0]).work
    found = [solution.ties[0].jump, *solution.ties[0].force, block.energy(solution.solids[0], 1.0), block.volume, work]
    found += modal.solve(model, 2).frequencies.tolist()
    motion = dynamics.solve(model, 0.2, 0.1, integrator="implicit")
    return [float(one) for one in (*found, np.linalg.norm(motion[-1].displacement))]


def same(expected, *mesh):
    np.testing.assert_allclose(answers(*mesh), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize("mesh", [("hexahedron", (1, 1, 1), 1), ("hexahedron", (2, 1, 1), 2)])
def test_ranks_without_cells_agree(mesh, on_ranks):
    expected = answers(*mesh)
    assert expected[5] == pytest.approx(32.0, rel=1e-12)
    on_ranks(3, f"test_solid_few_cells.same({expected!r}, *{mesh!r})")
