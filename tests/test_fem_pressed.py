"""Newton's method for finite elements in contact: the equations change their pattern while bodies come to touch."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from comparisons.fem.biceps.branches import Branches
from comparisons.fem.contact.surfaces import Contact
from comparisons.fem.pressed import Pressed
from comparisons.fem.statics import DIRECT, NEWTON
from isorod.options import defaults
from isorod.scenes.biceps import Biceps
from meshes import biceps


def test_factors_follow_the_pattern_of_the_contact():
    """Bellies that come to touch couple nodes that were not: the same solver has to solve the new equations too."""
    scene, mesh = Biceps(), biceps.build("bricks", around=4, layers=1, cuts=0, order=1)
    branches, contact = Branches(scene, mesh, 2), Contact(mesh, "first belly", "second belly", scene.penalty)
    first = np.unique(mesh.cells[mesh.regions["first muscle"]])
    with defaults(NEWTON | DIRECT | {"pc_type": "lu"}):
        newton = Pressed(branches, branches.residual, branches.tangent, branches.ends(), [contact])
    x, right, solver = newton.x, newton.x.duplicate(), newton.snes.getKSP()
    right.setArray(np.random.default_rng(5).normal(size=right.local_size))
    entries = []
    for way in (0.6, 0.85, 1.0):
        displacement = np.zeros_like(mesh.points)
        displacement[first, 0] = way
        x.setArray(branches.to_dofs(displacement))
        newton._tangent(newton.snes, x, newton.matrix, newton.matrix)
        solver.setOperators(newton.matrix)
        solver.solve(right, x)
        entries.append(newton.matrix.getInfo()["nz_used"])
        assert (newton.matrix * x - right).norm() < 1e-9 * right.norm()
    assert np.all(np.diff(entries) > 0)
    newton.destroy()
