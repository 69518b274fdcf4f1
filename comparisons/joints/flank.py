"""A strut welded to the flank of a column: compliances at the strut's end, coupled and meshed as one solid.

``python -m comparisons.joints.flank [RADIUS ...]`` prints them for struts of some radii (0.3, 0.6), whose ends are on
the column's axis, halfway, and where their rims are on its surface; the column's radius is 1.
"""

import sys
from typing import NamedTuple

import gmsh
import numpy as np
from numpy.typing import NDArray

import isorod
from comparisons.fem.statics import Held
from comparisons.joints import whole
from comparisons.joints.scene import by_gmsh, volumes
from comparisons.joints.whole import ROD, Problem, Whole
from isorod import LinearElastic, SectionLoad, Space, Tie, options, statics
from isorod.checks import embedded
from isorod.model import Body, Model, Support
from isorod.model.tie import EndFace, LateralSurface

Array = NDArray[np.float64]

# Half the column's length, and how far the strut stands out from its surface.
HALF, LENGTH = 4.0, 5.0
LAW = LinearElastic(1000.0, 0.3)
FORCE = 1e-3


class Coupled(NamedTuple):
    """Displacements of the strut's end along its force, over it: along the strut, across both, along the column.

    ``estimates`` are the errors by `isorod.checks.embedded`, of each force.
    """

    compliances: Array
    estimates: Array


def model(radius: float, start: float, axis: int, **space: object) -> Model:
    """Return column and strut, whose end is so far from the column's axis, under a force along an axis."""
    column = isorod.straight(2.0 * HALF, start=(0.0, 0.0, -HALF)).sweep(isorod.circle(8, 1.0))
    strut = isorod.straight(start=(start, 0.0, 0.0), end=(1.0 + LENGTH, 0.0, 0.0)).sweep(isorod.circle(8, radius))
    bodies = [Body(Space(rod, **space), LAW) for rod in (column, strut)]  # type: ignore[arg-type]
    supports = [Support.end(bodies[0].space, which) for which in ("start", "end")]
    force = FORCE * np.eye(3)[axis]
    load = SectionLoad((force[0], force[1], force[2]), body=1)
    return Model(bodies, supports, loads=[load], ties=[Tie(EndFace(1, "start"), LateralSurface(0))])


def coupled(radius: float, start: float, **space: object) -> Coupled:
    """Return the compliances of rods tied to each other."""
    compliances, estimates = [], []
    for axis in range(3):
        solved = statics.solve(model(radius, start, axis, **space))
        compliances.append(float(solved.at(1, "end")[axis]) / FORCE)
        estimates.append(embedded.of(solved).error)
    return Coupled(np.array(compliances), np.array(estimates))


def as_one(radius: float, near: float) -> Array:
    """Return the compliances of one solid of curved tetrahedra, of size ``near`` at the joint."""

    def make() -> str:
        occ = gmsh.model.occ
        column = occ.addCylinder(0, 0, -HALF, 0, 0, 2.0 * HALF, 1.0)
        occ.fuse([(3, column)], [(3, occ.addCylinder(0, 0, 0, 1.0 + LENGTH, 0, 0, radius))])
        occ.synchronize()
        volumes({ROD: [tag for _, tag in gmsh.model.getEntities(3)]})
        edge = f"Sqrt((Sqrt(y*y+z*z)-{radius})^2+(Sqrt(x*x+y*y)-1)^2+(x-Abs(x))^2)"
        return f"Min(0.6,{near}+0.4*{edge})"

    mesh, tags = by_gmsh(make, True)
    faces = {
        "low": whole.facets(mesh, lambda x: np.abs(x[2] + HALF) < 1e-6),
        "high": whole.facets(mesh, lambda x: np.abs(x[2] - HALF) < 1e-6),
        "pulled": whole.facets(mesh, lambda x: np.abs(x[0] - 1.0 - LENGTH) < 1e-6),
    }
    compliances = []
    for force in FORCE * np.eye(3):
        problem = Problem({ROD: LAW}, [Held("low"), Held("high")], (force[0], force[1], force[2]))
        compliances.append(whole.solve(Whole(mesh, tags, faces), problem).moved @ force / FORCE**2)
    return np.array(compliances)


def main(arguments: list[str]) -> None:
    """Print compliances, errors in per cent and their estimates."""
    options.initialize([])
    for radius in map(float, arguments or ("0.3", "0.6")):
        exact = as_one(radius, 0.05)
        print(f"strut {radius:g}, one solid", exact)
        for start in (0.0, 0.5, float(np.sqrt(1.0 - radius**2))):
            result = coupled(radius, start, section_degree=6)
            errors = 100.0 * (result.compliances / exact - 1.0)
            print(
                f"  from {start:.3g}: errors {errors.round(1)} %, estimated {(100.0 * result.estimates).round(1)} %",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1:])
