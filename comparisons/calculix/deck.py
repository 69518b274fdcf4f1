"""Input files of CalculiX: nodes, elements and faces of a `Mesh`, and the step that is asked for."""

from collections.abc import Sequence

from meshes import abaqus
from meshes.mesh import Mesh

# Elements by name: the order of the mesh they are made of.
ELEMENTS = {name: abaqus.ELEMENTS[name].order for name in ("C3D20R", "C3D20", "C3D8I", "C3D10")}


def body(mesh: Mesh, element: str, material: Sequence[str]) -> tuple[str, int]:
    """Return the lines of a mesh's cells as elements of one kind, of a material, and their number of nodes.

    Sets are those of `meshes.abaqus.lines`.
    """
    text, count = abaqus.lines(mesh, element)
    section = f"*SOLID SECTION,ELSET={abaqus.ALL_ELEMENTS},MATERIAL=LAW"
    return "\n".join([text, "*MATERIAL,NAME=LAW", *material, section]), count


def pulled(pull: float, solver: str) -> str:
    """Return the step of large displacements that moves the face ``end`` by ``pull`` along z, ``start`` held."""
    return "\n".join(
        [
            "*STEP,NLGEOM",
            f"*STATIC,SOLVER={solver},DIRECT",
            "1.,1.",
            "*BOUNDARY",
            "START,1,3,0.",
            "END,1,2,0.",
            f"END,3,3,{pull:.12g}",
            "*NODE PRINT,NSET=START,TOTALS=ONLY",
            "RF",
            "*NODE PRINT,NSET=END,TOTALS=ONLY",
            "RF",
            "*END STEP",
        ]
    )


def vibrating(modes: int, solver: str) -> str:
    """Return the step that asks for the lowest modes with the face ``start`` held."""
    return "\n".join(["*BOUNDARY", "START,1,3,0.", "*STEP", f"*FREQUENCY,SOLVER={solver}", str(modes), "*END STEP"])


# Reads the model, and stops: what it takes is no part of solving.
NOTHING = "*STEP\n*NO ANALYSIS\n*END STEP"
