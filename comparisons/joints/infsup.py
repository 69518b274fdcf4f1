"""The inf-sup constant of a weld in numbers: how much of tractions' work the discrete sides resolve, by slave.

``python -m comparisons.joints.infsup [end] [sleeve]``.  Multipliers are the traces of the slave.  Tractions among these
do work on what they do to both bodies, in the discrete spaces and, nearly, in all displacements; the square of the
constant is the smallest ratio of the two.  That of all displacements is taken of a fine mesh of the solid, for the rod
with the rod's modulus.
"""

import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.linalg import eigh
from scipy.sparse import csr_array, csr_matrix, identity
from scipy.sparse.linalg import splu

import isorod
from comparisons.joints import sleeve, weld
from comparisons.joints.lattice import circle, ring
from isorod import LinearElastic, Space
from isorod.assembly.constraints import Constraints
from isorod.assembly.formulation import assembler_for
from isorod.fenics.solid import Solid
from isorod.model import Body, Model, Support
from isorod.model.tie import EndFace, LateralSurface, SolidSurface, Surface, Tie
from isorod.space.trace import rows_at

Array = NDArray[np.float64]

NU = 0.3
CONTRASTS = (1.0, 10.0, 0.1)

# How far coarse facets may be from the rod's surface.
_GAP = 0.9

# Springs to the ground of a free rod, in fractions of its stiffness.
_SOFT = 1e-3


class Side(NamedTuple):
    """A body with modulus 1 that is held: its factor, which degrees of freedom are free, and its functions."""

    factor: Any
    free: Array
    functions: Any

    def compliance(self, values: Array, weighted: Array, points: Array) -> Array:
        """Return the work of multipliers ``(q, k)`` along each axis on the displacements by others, ``(3 k, 3 k)``."""
        nodes, functions = self.functions(points)
        count = self.free.size // 3
        start = np.arange(len(points) + 1) * nodes.shape[1]
        at = csr_array((functions.ravel(), nodes.ravel(), start), shape=(len(points), count))
        forces = at.T @ (weighted * values)
        k = values.shape[1]
        wide = np.zeros((3 * count, 3 * k))
        for a in range(3):
            wide[a::3, a::3] = forces
        wide = wide[self.free]
        return np.asarray(wide.T @ self.factor.solve(wide))


def _csr(matrix: PETSc.Mat) -> csr_matrix:
    first, column, entries = matrix.getValuesCSR()
    return csr_matrix((entries, column, first), shape=matrix.getSize())


def of_rod(space: Space, which: tuple[str, ...]) -> Side:
    """Return a rod that is held at some of its ends."""
    model = Model([Body(space, LinearElastic(1.0, NU))], [Support.end(space, one) for one in which])
    assembler = assembler_for(model)
    matrix = assembler.matrix()
    assembler.tangent(assembler.vector(), 0.0, matrix)
    unknown = model.free
    order = np.argsort(unknown[unknown >= 0])
    free = np.flatnonzero(unknown >= 0)[order]
    mask = np.zeros(3 * space.nodes, dtype=bool)
    mask[free] = True
    assert (np.diff(free) > 0).all()
    stiffness = _csr(matrix)
    if not which:
        # Rigid motions are seen anyhow.
        stiffness = stiffness + _SOFT * stiffness.diagonal().mean() * identity(stiffness.shape[0], format="csr")
    return Side(splu(stiffness.tocsc()), mask, lambda points: rows_at(space, points)[:2])


def of_solid(solid: Solid, facets: Any) -> Side:
    """Return a finite element body."""
    mask = np.ones(3 * solid.nodes, dtype=bool)
    mask[solid.held[0]] = False
    matrix = _csr(solid.tangent(np.zeros(3 * solid.nodes), 0.0))
    return Side(splu(matrix[mask][:, mask].tocsc()), mask, lambda points: solid.rows(points, facets)[:2])


class Pair(NamedTuple):
    """A rod and a solid that are tied, each as a side, the fine solid, and the rod's surface."""

    space: Space
    solid: Solid
    facets: Any
    sides: tuple[Side, Side, Side]
    surface: Surface

    def constants(self, slave: str) -> list[float]:
        """Return the constant for each contrast of the rod's to the solid's modulus."""
        sides: tuple[Surface, Surface] = self.surface, SolidSurface(0, self.facets)
        model = Model(
            [Body(self.space, LinearElastic(1.0, NU))],
            ties=[Tie(*(sides if slave == "rod" else sides[::-1]), _GAP)],
            solids=[Solid(self.solid.space, LinearElastic(1.0, NU))],
        )
        tied = Constraints(model).ties[0]
        values, trace = tied.multipliers[0].values.toarray(), tied.trace
        weights = trace.weights[:, None]
        rod, solid, fine = (side.compliance(values, weights, trace.points) for side in self.sides)
        lowest = []
        for contrast in CONTRASTS:
            seen, full = rod / contrast + solid, fine / contrast + fine
            lowest.append(float(np.sqrt(eigh(seen, full, eigvals_only=True, subset_by_index=(0, 0))[0])))
        return lowest


def ends() -> Iterator[tuple[float, Pair]]:
    """Yield ratios of the solid's size to the rod's, and rods welded on a block."""

    def block(near: float) -> tuple[Solid, Any]:
        made = weld.block(near, 1.5, hole=False)
        V = sleeve.vectors(made.mesh, 2)
        held = fem.dirichletbc(fem.Function(V), fem.locate_dofs_topological(V, 2, made.held))
        return Solid(V, LinearElastic(1.0, NU), conditions=[held]), made.joined

    fine = of_solid(*block(0.12))
    rod = isorod.straight(2.0, start=(0.0, 0.0, weld.HEIGHT)).sweep(isorod.circle(8))
    for near in (4.0, 1.0, 0.5):
        solid, facets = block(near)
        side = of_solid(solid, facets)
        for degree in (1, 2, 4, 8):
            space = Space(rod, section_degree=degree, elements=3, degree=3)
            # Spacing of functions: half a quadratic cell; for polynomials the diameter over their number.
            sides = of_rod(space, ("end",)), side, fine
            yield near * degree / 4.0, Pair(space, solid, facets, sides, EndFace(0, "start"))


def sleeves() -> Iterator[tuple[float, Pair]]:
    """Yield ratios of the solid's size to the rod's along the axis, and rods in a sleeve."""
    length = 4.0

    def tube(radial: int, around: int, along: int) -> tuple[Solid, Any]:
        made = ring(1.0, circle(2.0), length, (radial, around, along), "hexahedron", 1)
        V = sleeve.vectors(made.mesh, 1)
        held = fem.dirichletbc(fem.Function(V), fem.locate_dofs_topological(V, 2, made.outside))
        return Solid(V, LinearElastic(1.0, NU), conditions=[held]), made.hole

    fine = of_solid(*tube(6, 24, 48))
    rod = isorod.straight(length).sweep(isorod.circle(8))
    for along in (2, 4, 8, 16):
        solid, facets = tube(2, 12, along)
        side = of_solid(solid, facets)
        for elements in (2, 4, 8, 16):
            space = Space(rod, order=2, elements=elements, degree=2)
            yield elements / along, Pair(space, solid, facets, (of_rod(space, ()), side, fine), LateralSurface(0))


def main(parts: list[str]) -> None:
    """Print the constants of each pair."""
    for part in parts or ["end", "sleeve"]:
        for ratio, pair in ends() if part == "end" else sleeves():
            for slave in ("rod", "solid"):
                text = " ".join(f"{one:.3f}" for one in pair.constants(slave))
                print(f"{part:7s} size of solid to rod {ratio:6.3f}, slave {slave:5s}: {text}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
