"""Meshes and geometries (STEP) of the examples tendon and screw, by gmsh: python docs/meshes.py [FOLDER]."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import gmsh

from isorod import files

EXAMPLES = Path(files.__file__).parent / "examples"


def group(dimension: int, tags: Sequence[int], name: str) -> None:
    """Give a physical group its name."""
    gmsh.model.setPhysicalName(dimension, gmsh.model.addPhysicalGroup(dimension, tags), name)


def faces(matches: Callable[[str, Sequence[float]], bool]) -> list[int]:
    """Return the faces whose kind and middle are as they should be."""
    found = [
        (tag, gmsh.model.getType(2, tag), gmsh.model.occ.getCenterOfMass(2, tag))
        for _, tag in gmsh.model.getEntities(2)
    ]
    return [tag for tag, kind, middle in found if matches(kind, middle)]


def tendon() -> tuple[str, int]:
    """A block below z = 0; cells are small along the edge of the tendon, of radius 3."""
    gmsh.model.occ.addBox(-12, -8, -12, 24, 16, 12)
    gmsh.model.occ.synchronize()
    group(2, faces(lambda _, middle: abs(middle[2]) < 1e-6), "top")
    group(2, faces(lambda _, middle: abs(middle[2] + 12) < 1e-6), "bottom")
    return "1.2 + 0.4*Sqrt((Sqrt(x*x+y*y)-3)*(Sqrt(x*x+y*y)-3) + z*z)", 1


def screw() -> tuple[str, int]:
    """A plate from z = 2 to 8 with a hole of radius 2; cells are small along its rims, and curved."""
    plate, hole = gmsh.model.occ.addBox(-8, -8, 2, 16, 16, 6), gmsh.model.occ.addCylinder(0, 0, 2, 0, 0, 6, 2)
    gmsh.model.occ.cut([(3, plate)], [(3, hole)])
    gmsh.model.occ.synchronize()
    group(2, faces(lambda kind, _: kind == "Cylinder"), "hole")
    group(2, faces(lambda _, middle: max(abs(middle[0]), abs(middle[1])) > 7.9), "sides")
    away = "(Sqrt(x*x+y*y)-2)*(Sqrt(x*x+y*y)-2) + (Fabs(z-5)-3)*(Fabs(z-5)-3)"
    return f"0.8 + 0.6*Sqrt({away})", 2


def write(make: Callable[[], tuple[str, int]], folder: Path) -> None:
    """Write the mesh and the geometry of an example to files of its name."""
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        size, degree = make()
        gmsh.write(str(folder / f"{make.__name__}.step"))
        group(3, [tag for _, tag in gmsh.model.getEntities(3)], "body")
        for option in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
            gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
        field = gmsh.model.mesh.field.add("MathEval")
        gmsh.model.mesh.field.setString(field, "F", size)
        gmsh.model.mesh.field.setAsBackgroundMesh(field)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(degree)
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
        gmsh.write(str(folder / f"{make.__name__}.msh"))
    finally:
        gmsh.finalize()


if __name__ == "__main__":
    for one in (tendon, screw):
        write(one, Path(sys.argv[1]) if sys.argv[1:] else EXAMPLES)
