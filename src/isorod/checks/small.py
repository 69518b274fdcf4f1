"""Laws of small strains: whether their bodies stay where such laws hold."""

import warnings
from collections.abc import Sequence

import numpy as np

from isorod.arrays import Array
from isorod.assembly.gradients import displacement_gradients
from isorod.model import Model

# Largest component of the displacement's gradient: a rotation of so many radians is taken for a strain of half a
# percent.
LARGE = 0.1


def warn_of_large(model: Model, displacements: Array, solids: Sequence[Sequence[Array]] = ()) -> None:
    """Warn of bodies that are turned or strained by more than their laws of small strains know of.

    Parameters
    ----------
    model
        What has moved.
    displacements
        All degrees of freedom at outputs, shape ``(outputs, dofs)``.
    solids
        At each, what this rank has of each solid (`isorod.output.state.State.solids`); collective.
    """
    found = []
    for b, body in enumerate(model.bodies):
        small = next((law for law in body.laws if not law.objective), None)
        if small is None:
            continue
        table = body.space.tabulate(0, body.space.axis.elements)
        shape = (table.elements, body.space.axis.degree + 1, body.space.layer_nodes, 3)
        largest = 0.0
        for row in displacements:
            nodal = model.nodal(row, b)[body.space.element_nodes].reshape(shape)
            largest = max(largest, float(np.abs(displacement_gradients(table, nodal)).max()))
        found.append((f"body {b}", small, largest))
    for k, solid in enumerate(model.solids):
        if solid.law is not None and not solid.law.objective:
            found.append((f"solid {k}", solid.law, max(solid.largest_gradient(row[k]) for row in solids)))
    for which, law, largest in found:
        if largest > LARGE:
            warnings.warn(
                f"rotations or strains of {which} reach {largest:.2g}, the small-strain law {type(law).__name__} "
                f"needs less than {LARGE:g}; use a finite-strain law such as StVenantKirchhoff or OrthotropicKirchhoff",
                stacklevel=3,
            )
