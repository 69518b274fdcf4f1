"""Stiffness and mass per length of a section, 6 x 6, by finite elements on the section: `isorod.section_properties`.

``python -m comparisons.fem.section blade --u 0 --level 2``.

Strains and curvatures of the axis are given here and their warping is solved for: stretch, twist and both curvatures
first, then curvatures that grow along the prism, which is shear (D. Iesan, On Saint-Venant's problem, Arch. Rational
Mech. Anal. 91 (1986) 363-373); isorod gives forces and solves for strains and warping together.  What both have in
common is the energy of the six states under unit forces, here integrated from the stresses of these.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import dolfinx.fem
import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc

import isorod
from comparisons.fem import runs
from isorod import files
from isorod.errors import InputError
from isorod.fenics import compat
from isorod.fenics.flags import FAST
from isorod.geometry.quadrature import ring_of
from isorod.material.law import Isotropic
from isorod.model.body import Body
from isorod.output import results
from isorod.output.section_properties import apart
from meshes.mesh import Array, Index, lexicographic, match
from meshes.sections import sections

# In the order of forces: those that strain the axis evenly, axial force and moments, and shear.
_EVEN, _SHEAR = (0, 3, 4, 5), (1, 2)


@dataclass(frozen=True, eq=False)
class Section:
    """The finite elements' `isorod.output.section_properties.SectionProperties`, about the section's centroid.

    Attributes
    ----------
    stiffness, mass
        Shape ``(6, 6)``, in isorod's order and directions.
    unknowns, cells
        Of the mesh.
    """

    stiffness: Array
    mass: Array
    unknowns: int
    cells: int


def solve(body: Body, u: float, level: int = 2, degree: int = 3, flags: Sequence[str] = FAST) -> Section:
    """Return stiffness and mass per length of a body's section at ``u``, of isotropic laws.

    Parameters
    ----------
    level
        Cells in each direction, times the first level's (`meshes.sections`).
    degree
        Degree of warping and of the curved cells.

    Raises
    ------
    InputError
        If the mesh cannot be, a law is not isotropic, or on several ranks.
    """
    if MPI.COMM_WORLD.size > 1:
        raise InputError("section: only on one rank")
    runs.check_element(True, degree, "Lagrange", None, degree)
    if level < 1:
        raise InputError(f"level: got {level}, need 1 or more")
    states = _States(body, u, level, degree, flags)
    bare = [State(np.zeros_like(motion), motion) for motion in states.motions[list(_EVEN)]]
    even = [states.warped(state.rate) for state in bare]
    # The four forces of each state, and the combinations that carry a unit of each.
    mixtures = np.linalg.inv(states.energies(even, bare))
    unit_states = {force: _mixed(even, row) for force, row in zip(_EVEN, mixtures, strict=True)}
    # A shear force is the growth of a moment: M1' = Q2, M2' = -Q1.
    for force, moment, sign in ((1, 5, -1.0), (2, 4, 1.0)):
        growth = _mixed([unit_states[moment]], [sign])
        sheared = states.warped(growth.warping, growth)
        others = -states.energies([sheared], bare)[0] @ mixtures
        unit_states[force] = _mixed([sheared, *even], [1.0, *others])
    units = [unit_states[force] for force in range(6)]
    compliance = states.energies(units, units)
    return Section(np.linalg.inv(compliance), states.mass(), states.unknowns, states.cells)


class State(NamedTuple):
    """Displacement of a section and its change along the prism, both at nodes ``(dofs,)``."""

    warping: Array
    rate: Array


def _mixed(states: Sequence[State], factors: Sequence[float] | Array) -> State:
    """Return the sum of states times factors."""
    return State(*(sum(s * one for s, one in zip(factors, part, strict=True)) for part in zip(*states, strict=True)))


class _States:
    """Forms on the mesh of a section, with coordinates and components along first, second direction and normal.

    Attributes
    ----------
    motions
        The section's rigid motions, in the order of forces that work on them, at nodes ``(6, dofs)``.
    unknowns, cells
        Of the mesh.
    """

    def __init__(self, body: Body, u: float, level: int, degree: int, flags: Sequence[str]) -> None:
        self._flags = flags
        rod = body.space.rod
        seen = isorod.section_properties(body, u)
        template = next(sections(rod, degree)).make(level, degree)
        points = (rod.grid(template.points, [u])[0][0] - seen.centroid) @ seen.frame[[1, 2, 0]].T
        points[:, 2] = 0.0
        nodes = compat.reference_nodes("quadrilateral", degree)
        quads = template.quads[:, match(lexicographic(degree, 2), nodes)]
        self.mesh = compat.create_mesh(MPI.COMM_WORLD, quads, points, "quadrilateral", degree)
        self.space = compat.function_space(self.mesh, compat.element(self.mesh, "Lagrange", degree, 3))
        middles = np.linalg.norm(template.points[template.quads], axis=2).mean(axis=1)
        ring = ring_of(rod.rings, np.stack([middles, np.zeros(len(middles))], axis=1))[compat.original_cells(self.mesh)]
        element = int(np.searchsorted(body.space.axis.breaks[1:-1], u, side="right"))
        rings = len(rod.rings) - 1
        laws = body.laws[element * rings : (element + 1) * rings]
        if not all(isinstance(law, Isotropic) and not law.families for law in laws):
            raise InputError("section: the finite element side has isotropic laws only")
        self.mu, self.lame = (self._on_cells([getattr(law, name) for law in laws], ring) for name in ("mu", "lame"))
        self.density = self._on_cells(body.densities[element * rings : (element + 1) * rings], ring)
        self.unknowns, self.cells = 3 * int(self.space.dofmap.index_map.size_global), len(ring)

        self._dx = ufl.dx(metadata={"quadrature_degree": 2 * degree + 4})
        self._fields = [dolfinx.fem.Function(self.space) for _ in range(4)]
        warping, rate, other, change = self._fields
        trial, test = ufl.TrialFunction(self.space), ufl.TestFunction(self.space)
        stress = self._stress(ufl.grad(warping) + _along(rate))
        self._energy = self._form(ufl.inner(stress, ufl.grad(other) + _along(change)))
        self._inertia = self._form(self.density * ufl.inner(rate, change))
        # The change of the stress on the section pushes like a force in it.
        push = ufl.inner(self._stress(ufl.grad(other) + _along(change)), _along(test))
        self._load = self._form(push - ufl.inner(self._stress(_along(rate)), ufl.grad(test)))
        stiffness = self._form(ufl.inner(self._stress(ufl.grad(trial)), ufl.grad(test)))
        self._matrix = compat.create_matrix(stiffness, None)
        compat.assemble_matrix(self._matrix, stiffness, [])
        self._factorise()
        self.motions = self._rigid()

    def _form(self, integrand: Any) -> Any:
        return compat.form(integrand * self._dx, self._flags)

    def _on_cells(self, values: Sequence[float] | Array, ring: Index) -> Any:
        """Return a function that is constant on each cell, of the values of rings."""
        function = dolfinx.fem.Function(compat.function_space(self.mesh, ("DG", 0)))
        function.x.array[:] = np.asarray(values, dtype=float)[ring]
        return function

    def _stress(self, gradient: Any) -> Any:
        strain = ufl.sym(gradient)
        return 2.0 * self.mu * strain + self.lame * ufl.tr(strain) * ufl.Identity(3)

    def _rigid(self) -> Array:
        """Return the rigid motions, linear in the coordinates of the nodes, at which the cells are as well."""
        y, z, _ = self.space.tabulate_dof_coordinates().T
        motions = np.zeros((6, len(y), 3))
        motions[0, :, 2] = motions[1, :, 0] = motions[2, :, 1] = 1.0
        motions[3, :, 0], motions[3, :, 1] = -z, y
        motions[4, :, 2], motions[5, :, 2] = z, -y
        return motions.reshape(6, -1)

    def _factorise(self) -> None:
        """Hold the section: a node, and another one, farthest from it, across the line to it; and factorise."""
        places = self.space.tabulate_dof_coordinates()
        first = int(np.argmin(places[:, 0]))
        arms = places - places[first]
        last = int(np.argmax(np.linalg.norm(arms, axis=1)))
        across = int(np.argmin(np.abs(arms[last, :2])))
        self._held = np.array([3 * first, 3 * first + 1, 3 * first + 2, 3 * last + across], dtype=np.int32)
        self._matrix.zeroRowsColumns(self._held, self._matrix.getDiagonal().max()[1])
        self._factor = PETSc.PC().create(MPI.COMM_WORLD)
        self._factor.setOperators(self._matrix)
        self._factor.setType(PETSc.PC.Type.LU)
        self._factor.setFactorSolverType("mumps")

    def _set(self, *states: State) -> None:
        """Set the fields of the forms."""
        parts = [part for state in states for part in state]
        for field, part in zip(self._fields, parts, strict=True):
            field.x.array[:] = part

    def warped(self, rate: Array, growth: State | None = None) -> State:
        """Return the state in equilibrium with a rate of displacements, and with the rate of stresses of ``growth``."""
        nothing = np.zeros_like(rate)
        self._set(State(nothing, rate), growth or State(nothing, nothing))
        force = self._matrix.createVecLeft()
        compat.assemble_vector(force, self._load)
        force.array[self._held] = 0.0
        displacement = force.duplicate()
        self._factor.apply(force, displacement)
        return State(displacement.array.copy(), rate)

    def energies(self, states: Sequence[State], others: Sequence[State]) -> Array:
        """Return the work of the stresses of states on the strains of others, shape ``(states, others)``."""
        return self._products(self._energy, states, others)

    def mass(self) -> Array:
        """Return the mass per length ``(6, 6)``."""
        rigid = [State(np.zeros_like(motion), motion) for motion in self.motions]
        return self._products(self._inertia, rigid, rigid)

    def _products(self, form: Any, states: Sequence[State], others: Sequence[State]) -> Array:
        products = np.empty((len(states), len(others)))
        for i, state in enumerate(states):
            for j, other in enumerate(others):
                self._set(state, other)
                products[i, j] = dolfinx.fem.assemble_scalar(form)
        return products


def _along(rate: Any) -> Any:
    """Return the gradient of a displacement that changes at a rate along the normal."""
    return ufl.outer(rate, ufl.as_vector([0.0, 0.0, 1.0]))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print stiffness and mass of a scene's section, and by how much isorod's differ from it."""
    parser = argparse.ArgumentParser(prog="comparisons.fem.section", description="Stiffness of a section.")
    parser.add_argument("scene", metavar="SCENE", help="its name, or that of a .toml file")
    parser.add_argument("--rod", type=int, default=0, metavar="B", help="number of the rod in the scene (0)")
    parser.add_argument("--u", type=float, default=0.0, metavar="U", help="axis parameter (0)")
    parser.add_argument(
        "--level", type=int, default=2, metavar="L", help="cells in each direction, times level 1's (2)"
    )
    parser.add_argument("--degree", type=int, default=3, metavar="P", help="degree of warping and cells, 1 to 4 (3)")
    given = parser.parse_args(arguments)
    try:
        scene: Any = files.find(given.scene)
        if scene.analysis == "geometry":
            raise InputError(f"{given.scene}: geometry alone, without laws")
        bodies = scene.model().bodies
        if not 0 <= given.rod < len(bodies):
            raise InputError(f"rod: got {given.rod}, need 0 to {len(bodies) - 1}")
        body = bodies[given.rod]
        result = solve(body, given.u, given.level, given.degree)
        own = isorod.section_properties(body, given.u)
        record = {
            **vars(given),
            **vars(result),
            "isorod": own.stiffness,
            "functions": own.functions,
            "estimated": own.error,
            "apart": apart(result.stiffness, own.stiffness),
            **runs.provenance(),
        }
        print(results.line(record))
    except InputError as problem:
        print(f"comparisons.fem.section: {problem}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
