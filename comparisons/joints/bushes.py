"""A spring of wire whose legs are bonded in two rubber blocks, which are pushed towards each other; mm and N."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, ClassVar

import gmsh
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_lsq_spline

import isorod
from comparisons.fem.statics import Held
from comparisons.joints import whole
from comparisons.joints.scene import Array, Scene, Sizes, by_gmsh, fixed, fragments, volumes
from comparisons.joints.whole import BLOCK, ROD, Layers, Problem, Whole
from isorod import Material, NeoHookean, Rod, Space, Tie, statics
from isorod.fenics.solid import Solid
from isorod.model import Body, Model
from isorod.model.tie import LateralSurface, SolidSurface

# Of the wire and its coil; length of its legs, and of the bends between these and the coil.
RADIUS, COIL, PITCH, TURNS, LEG, BEND = 1.0, 8.0, 4.0, 6.0, 8.0, 8.0

# Outer radius of the blocks, which are as high as the legs are long.
BLOCK_RADIUS = 5.0

# Elements of the centre line a turn, and in a bend; its degree.
_A_TURN, _A_BEND, _DEGREE = 6, 3, 5


def _path(coil: float) -> tuple[Array, Array, float]:
    """Return lengths and points of a centre line with so much length of coil, and how far round it goes in all.

    It stays on a cylinder; its slope goes smoothly from that of the legs, which are upright, to that of the coil.
    """
    s = np.linspace(0.0, 2.0 * (LEG + BEND) + coil, 20001)
    low = np.arctan2(PITCH, 2.0 * np.pi * COIL)
    from_ends = np.minimum(s, s[-1] - s)
    slope = low + (0.5 * np.pi - low) * 0.5 * (1.0 + np.cos(np.pi * np.clip((from_ends - LEG) / BEND, 0.0, 1.0)))
    around, up = (
        np.concatenate([[0.0], np.cumsum(0.5 * np.diff(s) * (one[1:] + one[:-1]))])
        for one in (np.cos(slope) / COIL, np.sin(slope))
    )
    return s, np.stack([COIL * np.cos(around), COIL * np.sin(around), up - LEG], axis=1), float(around[-1])


@dataclass(frozen=True)
class Spring(Scene):
    """Six coils of steel wire between two blocks of rubber."""

    quantities = ("force",)
    laws: ClassVar[Mapping[int, Material]] = {ROD: NeoHookean(2.0e5, 0.3), BLOCK: NeoHookean(10.0, 0.45)}
    push = (0.0, 0.0, -5.0)

    @cached_property
    def rod(self) -> Rod:  # type: ignore[override]
        """The wire; its axis parameter is about the length."""
        low, high = 0.0, 1000.0
        while high - low > 1e-10:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _path(middle)[2] < 2.0 * np.pi * TURNS else (low, middle)
        s, points, _ = _path(low)
        length, start = s[-1], LEG + BEND
        bend, coil = np.linspace(LEG, start, _A_BEND + 1), np.linspace(start, length - start, int(TURNS * _A_TURN) + 1)
        inner = np.unique(np.concatenate([bend, coil, length - bend]).round(12))
        times = np.where(np.isin(inner, [LEG, np.round(length - LEG, 12)]), 3, 1)
        ends = np.zeros(_DEGREE + 1)
        knots = np.concatenate([ends, np.repeat(inner, times), ends + length])
        in_leg = np.minimum(s, length - s) <= LEG
        curve = make_lsq_spline(s, points, knots, _DEGREE, np.where(in_leg, 1e3, 1.0))
        # Legs are straight, to the last digit: they end where the blocks do.
        order = np.arange(len(curve.c))
        at = np.array([knots[k + 1 : k + 1 + _DEGREE].mean() for k in order])
        leg = np.minimum(order, order[::-1])[:, None] <= _DEGREE
        upright = np.stack([0.0 * at + COIL, 0.0 * at, np.where(at < start, at - LEG, points[-1, 2] + at - length)], 1)
        centers = np.where(leg, upright, curve.c)
        line = isorod.nurbs(SimpleNamespace(degree=_DEGREE, knotvector=knots, ctrlpts=centers))
        return line.sweep(isorod.circle(8, RADIUS))

    @cached_property
    def _ends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Axis parameters between which the legs are."""
        low, high = self.rod.axis.breaks[[0, -1]]
        return (float(low), LEG), (float(high) - LEG, float(high))

    @cached_property
    def _rises(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """``z`` between which the blocks are."""
        heights = self.rod.points([[0.0, 0.0]], np.ravel(self._ends))[..., 2].ravel()
        return (heights[0], heights[1]), (heights[2], heights[3])

    def place(self, along: float, points: Array) -> Array:
        """Return where points of the section are."""
        middle, jacobian = self.rod.grid([[0.0, 0.0]], [along])
        return np.asarray(middle[0] + points / RADIUS @ jacobian[0, 0, :, :2].T)

    def section(self, sizes: Sizes) -> whole.Section:
        """Return the section of wire and block."""
        outline = whole.circle(BLOCK_RADIUS)
        return whole.section(RADIUS, sizes.around, sizes.rings, outline, sizes.near, sizes.far)

    def layers(self, sizes: Sizes) -> Sequence[Layers]:
        """Return layers of bricks along the wire."""
        near, (first, last) = (sizes.near, sizes.near), self._ends
        legs = [Layers(whole.spaced(one, sizes.far, near), ROD, BLOCK) for one in (first, last)]
        coil = Layers(whole.spaced((first[1], last[0]), sizes.wire, near), ROD, 0)
        return [legs[0], coil, legs[1]]

    def _outside(self, k: int) -> Any:
        low, high = self._rises[k]
        return lambda x: (
            (np.hypot(x[0] - COIL, x[1]) > BLOCK_RADIUS - 1e-2) & (x[2] > low - 1e-2) & (x[2] < high + 1e-2)
        )

    def faces(self, mesh: Any) -> Mapping[str, NDArray[np.int32]]:
        """Return the facets that are held."""
        return {name: whole.facets(mesh, self._outside(k)) for k, name in enumerate(("lower", "upper"))}

    def problem(self) -> Problem:
        """Return the problem of the solid."""
        return Problem(self.laws, [Held("lower"), Held("upper", self.push)])

    def of_whole(self, solution: whole.Solution) -> Array:
        """Return the force on the upper block."""
        return np.asarray(solution.reactions[1, 2:])

    def bush(self, k: int, radius: float) -> int:
        """Make a cylinder round a leg in gmsh's kernel; return its tag."""
        low, high = self._rises[k]
        return int(gmsh.model.occ.addCylinder(COIL, 0, low, 0, 0, high - low, radius))

    def edges(self, sizes: Sizes) -> str:
        """Return the size of gmsh's cells in blocks."""
        size = f"{sizes.far}"
        for z in np.ravel(self._rises):
            size = f"Min({size},{sizes.near}+0.5*Sqrt((Sqrt((x-{COIL})^2+y*y)-{RADIUS})^2+(z-({z}))^2))"
        return size

    def tetrahedra(self, sizes: Sizes) -> Whole:
        """Return wire and blocks meshed as one solid, by gmsh: the wire is a pipe along its centre line."""
        axis = self.rod.axis
        knots, times = np.unique(axis.knots, return_counts=True)
        centers = self.rod.control_points.mean(axis=1)

        def make() -> str:
            occ = gmsh.model.occ
            points = [occ.addPoint(*one) for one in centers]
            curve = occ.addBSpline(points, degree=axis.degree, knots=knots, multiplicities=times)
            disk = occ.addDisk(*centers[0], RADIUS, RADIUS)
            wire = occ.addPipe([(2, disk)], occ.addWire([curve]))
            occ.remove([(2, disk)])
            bushes = [(3, self.bush(k, BLOCK_RADIUS)) for k in range(2)]
            volumes(fragments([*bushes, wire[0]], [BLOCK, BLOCK, ROD]))
            (_, low), (high, _) = self._rises
            between = f"1000*(Max(0,{low}-z)+Max(0,z-({high})))"
            return f"Min({self.edges(sizes)},{sizes.wire}+{between})"

        mesh, tags = by_gmsh(make, True)
        return Whole(mesh, tags, self.faces(mesh))

    def blocks(self, sizes: Sizes, shape: str) -> Sequence[Any]:
        """Return the meshes of the blocks alone."""
        if shape == "hexahedron":
            cut, layers = self.section(sizes), self.layers(sizes)
            return [whole.bricks(cut, [layers[k]._replace(inner=0)], self.place)[0] for k in (0, 2)]

        def make(k: int) -> str:
            gmsh.model.occ.cut([(3, self.bush(k, BLOCK_RADIUS))], [(3, self.bush(k, RADIUS))])
            gmsh.model.occ.synchronize()
            volumes({BLOCK: [tag for _, tag in gmsh.model.getEntities(3)]})
            return self.edges(sizes)

        return [by_gmsh(lambda k=k: make(k), True)[0] for k in range(2)]  # type: ignore[misc]

    def held(self, block: int, space: Any) -> list[Any]:
        """Return the supports of a block."""
        return [fixed(space, self._outside(block), self.push if block else (0.0, 0.0, 0.0))]

    def space(self, **chosen: Any) -> Space:
        """Return a space with joints of elements where the blocks begin."""
        return self.jointed((self._ends[0][1], self._ends[1][0]), **chosen)

    def model(self, space: Space, solids: Sequence[Solid]) -> Model:
        """Return wire and blocks."""
        length = self.rod.arc_length(np.ravel(self._ends))
        ties = []
        for k, solid in enumerate(solids):
            hole = whole.facets(solid.space.mesh, lambda x: np.hypot(x[0] - COIL, x[1]) < 1.001 * RADIUS + 1e-2)
            leg = LateralSurface(0, (float(length[2 * k]), float(length[2 * k + 1])))
            ties.append(Tie(SolidSurface(k, hole), leg))
        return Model([Body(space, self.laws[ROD])], [], ties=ties, solids=solids)

    def of_coupled(self, solution: statics.Equilibrium) -> Array:
        """Return the force on the upper block, which balances the tie's."""
        return -solution.ties[1].force[2:]
