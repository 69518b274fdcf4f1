"""Results of finite element bodies beside the rods, and these bodies as VTK's grids."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array
from isorod.errors import whole_number
from isorod.model.model import Model

if TYPE_CHECKING:
    import pyvista

    from isorod.fenics.solid import Solid


class WithSolids:
    """A state of a model with finite element bodies (`isorod.output.state.State`)."""

    model: Model
    solids: Sequence[Array]

    def solid_fields(self, solid: int) -> dict[str, Array]:
        """Return fields of a solid by name, each ``(3 nodes,)`` on this rank; empty if not known."""
        return {"displacement": self.solids[solid]} if len(self.solids) else {}

    def function(self, solid: int = 0) -> Any:
        """Return the displacement of a solid as a dolfinx Function; collective."""
        number = whole_number("solid", solid, 0, len(self.model.solids) - 1)
        return self.model.solids[number].function(self.solids[number])


def owned(model: Model, everywhere: Array) -> list[Array]:
    """Return the degrees of freedom of each solid on this rank, given those of all solids on all ranks."""
    parts, first = [], 0
    for solid in model.solids:
        begin, end = (first + 3 * node for node in solid.owned)
        parts.append(np.array(everywhere[begin:end]))
        first += 3 * solid.nodes
    return parts


def summary(solid: "Solid", name: str) -> str:
    """Return a summary of a body: its cells, nodes, volume and law; collective."""
    from isorod.fenics.groups import described

    entries = described(solid)
    cells = f"{entries['cells']:,} {entries['kind']} of degree {entries['degree']}, {entries['nodes']:,} nodes"
    law = "a form" if solid.law is None else type(solid.law).__name__
    return f"{name}, {cells}, volume {solid.volume:.6g}, {law}"


def mesh_of(solid: "Solid") -> "pyvista.UnstructuredGrid":
    """Return the undeformed body, on one rank.

    Raises
    ------
    InputError
        If pyvista is not installed.
    """
    from isorod.fenics import compat
    from isorod.output import vtk

    vtk.require()
    import pyvista

    return pyvista.UnstructuredGrid(*compat.vtk_cells(solid.space))


def grid(solid: "Solid", fields: Mapping[str, Array], factor: float = 1.0) -> "pyvista.UnstructuredGrid":
    """Return the undeformed body with fields and, with a ``displacement`` and a law, ``von_mises``, on one rank.

    Stresses are those of displacement gradients averaged at the nodes.

    Parameters
    ----------
    fields
        By name, each of shape ``(3 nodes,)``.
    factor
        Load factor, which scales activation.

    Raises
    ------
    InputError
        If pyvista is not installed.
    """
    from isorod.output import stress

    mesh = mesh_of(solid)
    for name, field in fields.items():
        mesh.point_data[name] = field.reshape(-1, 3)
    if solid.law is not None and "displacement" in fields:
        law, F = solid.law.at(factor), np.eye(3) + solid.gradients(fields["displacement"])
        cauchy = law.stress(F)
        if not law.linear:
            cauchy = cauchy @ F.swapaxes(1, 2) / np.linalg.det(F)[:, None, None]
        mesh.point_data["von_mises"] = stress.von_mises(cauchy)
    return mesh
