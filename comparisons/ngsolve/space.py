"""Displacements in NGSolve: three components at each function of H1, of full or serendipity degree, and rules."""

from typing import Any

import ngsolve

from comparisons.fem.quadrature import irons14
from meshes.mesh import gauss

# NGSolve's name of the direct solver: its own Cholesky factors, which are faster than UMFPACK's.
INVERSE = "sparsecholesky"

# Degree of the functions on the faces of a serendipity brick by the brick's own.
_ON_FACES = {2: 1, 3: 1, 4: 2}


def displacements(mesh: ngsolve.Mesh, degree: int, family: str, held: str, components: int = 3) -> ngsolve.H1:
    """Return the space: ``Lagrange``, ``S`` (serendipity), or ``hollow``, without functions inside of a cell alone.

    Nodes of the boundaries ``held`` (names, joined by ``|``) are not free.

    One space of blocks, not three spaces: factorisation and products then work on 3 x 3 entries, and take a third of
    the time.
    """
    space = ngsolve.H1(mesh, order=degree, dirichlet=held, dim=components)
    if family == "S":
        for face in mesh.faces:
            space.SetOrder(ngsolve.NodeId(ngsolve.FACE, face.nr), _ON_FACES[degree])
    if family != "Lagrange":
        for cell in range(mesh.ne):
            space.SetOrder(ngsolve.NodeId(ngsolve.CELL, cell), 1)
        space.UpdateDofTables()
    return space


def measure(mesh: ngsolve.Mesh, rule: int | str) -> Any:
    """Return the measure of the body with a rule: its degree, or ``irons14`` on bricks."""
    shape = next(iter(mesh.Elements(ngsolve.VOL))).type
    if shape == ngsolve.ET.TET:
        assert isinstance(rule, int)
        return ngsolve.dx(intrules={shape: ngsolve.IntegrationRule(shape, rule)})
    if isinstance(rule, str):
        points, weights = irons14()
    else:
        points, weights = gauss("hexahedron", rule)
    given = ngsolve.IntegrationRule([tuple(point) for point in points.tolist()], weights.tolist())
    return ngsolve.dx(intrules={shape: given})
