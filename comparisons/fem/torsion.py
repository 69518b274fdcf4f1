"""Saint-Venant torsion constant of a section, between bounds.

``python -m comparisons.fem.torsion --around 64 --rings 8``.

The section is meshed through its own map of the disk.  Warping in the space of finite elements makes the bar too stiff,
a stress function too soft, so that the constant of the meshed section lies between the two answers.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import dolfinx.fem
import numpy as np
import ufl
from dolfinx.mesh import locate_entities_boundary
from mpi4py import MPI
from petsc4py import PETSc

from comparisons.fem import compat
from comparisons.fem.flags import FAST
from isorod.errors import InputError
from isorod.geometry import section
from isorod.geometry.disk import harmonic_functions
from isorod.output import results
from meshes.mesh import Array, Index, lexicographic, match
from meshes.template import o_grid


@dataclass(frozen=True)
class Torsion:
    """Bounds of the torsion constant ``J``, length^4: torque is ``G J`` times twist per length."""

    lower: float
    upper: float
    area: float
    unknowns: int


def solve(outline: Array, around: int = 64, rings: int = 8, degree: int = 3) -> Torsion:
    """Return the torsion constant of the section with the control points ``outline`` ``(n, 2)``.

    Parameters
    ----------
    around
        Quadrilaterals round the section: ``8 n / gcd(n, 4)`` or a multiple has vertices where the outline's curvature
        jumps.
    rings
        Rings of quadrilaterals round the core.
    degree
        Degree of warping and stress function, and of the cells.

    Raises
    ------
    InputError
        If the mesh cannot be, or on several ranks.
    """
    if MPI.COMM_WORLD.size > 1:
        raise InputError("torsion: only on one rank")
    template = o_grid(around, rings, degree)
    values, _ = harmonic_functions(len(outline), np.clip(template.points, -1.0, 1.0))
    points = np.zeros((len(template.points), 3))
    points[:, :2] = values @ outline
    cells = template.quads[:, match(lexicographic(degree, 2), compat.reference_nodes("quadrilateral", degree))]
    mesh = compat.create_mesh(MPI.COMM_WORLD, cells, points, "quadrilateral", degree)

    space = compat.function_space(mesh, ("Lagrange", degree))
    measure = ufl.dx(metadata={"quadrature_degree": 2 * degree + 4})
    x, y, _ = ufl.SpatialCoordinate(mesh)
    turn = ufl.as_vector([-y, x, 0.0])
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    stiffness = compat.form(ufl.inner(ufl.grad(u), ufl.grad(v)) * measure, FAST)

    def solution(load: Any, held: Index) -> Any:
        matrix, found = compat.create_matrix(stiffness, None), dolfinx.fem.Function(space)
        compat.assemble_matrix(matrix, stiffness, [dolfinx.fem.dirichletbc(PETSc.ScalarType(0.0), held, space)])
        force = matrix.createVecLeft()
        compat.assemble_vector(force, compat.form(load * measure, FAST))
        force.array[held] = 0.0
        pc = PETSc.PC().create(mesh.comm)
        pc.setOperators(matrix)
        pc.setType(PETSc.PC.Type.LU)
        pc.setFactorSolverType("mumps")
        pc.apply(force, compat.petsc_vector(found))
        return found

    rim = locate_entities_boundary(mesh, 1, lambda where: np.full(where.shape[1], True))
    stress = solution(2.0 * v, dolfinx.fem.locate_dofs_topological(space, 1, rim))
    warping = solution(-ufl.inner(turn, ufl.grad(v)), np.array([0], dtype=np.int32))
    strain = ufl.grad(warping) + turn

    def integral(value: Any) -> float:
        return float(dolfinx.fem.assemble_scalar(compat.form(value * measure, FAST)))

    one = dolfinx.fem.Constant(mesh, PETSc.ScalarType(1.0))
    return Torsion(
        lower=integral(2.0 * stress),
        upper=integral(ufl.inner(strain, strain)),
        area=integral(one),
        unknowns=int(space.dofmap.index_map.size_global),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the torsion constant of the blade's root section."""
    parser = argparse.ArgumentParser(prog="comparisons.fem.torsion", description="Torsion constant of the airfoil.")
    parser.add_argument("--around", type=int, default=64, metavar="N", help="quadrilaterals round the section (64)")
    parser.add_argument("--rings", type=int, default=8, metavar="N", help="rings round the core (8)")
    parser.add_argument("--degree", type=int, default=3, metavar="P", help="degree of elements and cells (3)")
    given = vars(parser.parse_args(arguments))
    try:
        print(results.line({"section": "airfoil", **given, **asdict(solve(section.airfoil(), **given))}))
    except InputError as problem:
        print(f"comparisons.fem.torsion: {problem}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
