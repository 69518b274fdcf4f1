"""The spring between two rubber blocks as a scene file, with meshes and geometries of the blocks, as a user has them.

``python -m comparisons.joints.spring_file FOLDER`` writes ``spring-blocks.toml`` and what it names;
``isorod compare spring-blocks.toml`` sets it beside finite elements of wire and blocks as one solid.
"""

import sys
from pathlib import Path

import gmsh
import numpy as np

from comparisons.joints.bushes import BLOCK_RADIUS, LEG, RADIUS, Spring
from comparisons.joints.scene import Sizes, tetrahedra, volumes
from comparisons.joints.whole import BLOCK

# Sizes of the cells of the blocks' meshes.
SIZES = Sizes(0.2, 1.5)

_SCENE = """title = "spring between rubber blocks"        # mm, N: stresses in MPa

[rod.wire]
section = {{circle = {radius}}}
space = {{section_degree = 4}}               # rings, which others have in holes, change nothing here
law = {{NeoHookean = {{E = 2.0e5, nu = 0.3}}}}
[rod.wire.curve.nurbs]
points = "wire.txt"
degree = {degree}
knots = {knots}

[solid.lower]
mesh = "lower.msh"
geometry = "lower.step"
law = {{NeoHookean = {{E = 10.0, nu = 0.45}}}}
held = "outside"

[solid.upper]
mesh = "upper.msh"
geometry = "upper.step"
law = {{NeoHookean = {{E = 10.0, nu = 0.45}}}}
held = {{group = "outside", displacement = [0.0, 0.0, {push}]}}

[tie.lower]
slave = "lower.hole"
master = "wire.outer"

[tie.upper]
slave = "upper.hole"
master = "wire.outer"

[analysis.statics]

[measure.force]
tie_force = "upper"
component = "z"
unit = "N"
"""


def write(folder: Path, sizes: Sizes = SIZES) -> Path:
    """Write the scene and the files it names; return its path."""
    spring = Spring()
    axis = spring.rod.axis
    np.savetxt(folder / "wire.txt", spring.rod.control_points.mean(axis=1))
    for k, name in enumerate(("lower", "upper")):
        _block(spring, k, folder / name, sizes)
    file = folder / "spring-blocks.toml"
    file.write_text(
        _SCENE.format(radius=RADIUS, degree=axis.degree, knots=[*map(float, axis.knots)], push=spring.push[2])
    )
    return file


def _block(spring: Spring, k: int, path: Path, sizes: Sizes) -> None:
    """Write the geometry of a block, whole, and the mesh of what is round the wire, with groups."""
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Verbosity", 1)
        occ, model = gmsh.model.occ, gmsh.model
        block = (3, spring.bush(k, BLOCK_RADIUS))
        occ.synchronize()
        gmsh.write(str(path.with_suffix(".step")))
        occ.cut([block], [(3, spring.bush(k, RADIUS))])
        volumes({BLOCK: [tag for _, tag in model.getEntities(3)]})
        for name, radius in (("hole", RADIUS), ("outside", BLOCK_RADIUS)):
            own = [
                tag
                for _, tag in model.getEntities(2)
                if model.getType(2, tag) == "Cylinder"
                and abs(occ.getMass(2, tag) - 2.0 * np.pi * radius * LEG) < 1e-2 * occ.getMass(2, tag)
            ]
            model.setPhysicalName(2, model.addPhysicalGroup(2, own), name)
        tetrahedra(spring.edges(sizes))
        gmsh.write(str(path.with_suffix(".msh")))
    finally:
        gmsh.finalize()


if __name__ == "__main__":
    print(write(Path(sys.argv[1])))
