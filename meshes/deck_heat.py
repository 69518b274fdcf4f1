"""Temperatures in the words of Abaqus and CalculiX: ``*EXPANSION``, ``*INITIAL CONDITIONS``, ``*TEMPERATURE``."""

from collections.abc import Iterator

import numpy as np

from isorod.errors import InputError
from isorod.material.places import Places
from isorod.material.thermal import Thermal
from isorod.model.model import Model
from meshes.mesh import Array, Index, Mesh


def expansion(law: Thermal) -> list[str]:
    """Return the lines of a law's expansion; `InputError` where it is more than one number."""
    if len(law.stiffness):
        raise InputError("a stiffness that depends on the temperature is not written to .inp")
    # Laws with several have fibres, which are refused.
    return ["*EXPANSION,ZERO=0.", f"{float(np.ravel(law.expansion)[0]):.12g}"]


def temperatures(mesh: Mesh, model: Model) -> Array:
    """Return the change of temperature of each node of a mesh of rods at full load, shape ``(nodes,)``."""
    result = np.zeros(len(mesh.points))
    for k, body in enumerate(model.bodies):
        law = next((one for one in body.laws if isinstance(one, Thermal)), None)
        if law is None:
            continue
        nodes = np.unique(mesh.cells[mesh.regions[f"rod {k}"]])
        place = mesh.parameters_in(k, nodes)
        # One of the other laws has another expansion, but the rod's temperature.
        placed = law.placed(Places(body.space.rod, place[:, 2], place[:, :2]))
        result[nodes] = placed.temperature
    return result


def lines(head: str, number: Index, values: Array) -> Iterator[str]:
    """Yield a keyword and the temperatures of nodes that are in the file."""
    yield head
    for node, value in zip(number.tolist(), values.tolist(), strict=True):
        if node:
            yield f"{node},{value:.12g}"
