"""Forces in ties of parts of one solid: internal forces of the slave alone at the common nodes."""

from collections.abc import Sequence
from typing import NamedTuple

import basix
import numpy as np

from comparisons.fem.contact.facets import facet_of, gauss
from comparisons.fem.rods.elements import Elements
from comparisons.fem.rods.loads import dead
from comparisons.fem.rods.solution import Solution
from isorod.files.solid import OfBody
from isorod.model.tie import SolidSurface
from meshes.mesh import Array


class Carried(NamedTuple):
    """Force and moment of a tie on the slave, as in `isorod.checks.tie_result.TieResult`; moments about ``center``."""

    force: Array
    moment: Array
    center: Array


def carried(solution: Solution, elements: Elements, rule: int, bodies: Sequence[OfBody]) -> list[Carried]:
    """Return force and moment of each tie at full load; ``rule`` is the degree of the energy's quadrature."""
    source, model = solution.mesh, solution.model
    shape = getattr(basix.CellType, source.shape)
    points, weights = (np.asarray(one) for one in basix.make_quadrature(shape, rule))
    results = []
    for k, tie in enumerate(model.ties):
        slave = tie.slave
        region = f"solid {slave.solid}" if isinstance(slave, SolidSurface) else f"rod {slave.body}"
        inner = solution.internal_forces(source.regions[region], points, weights)
        nodal = inner - dead(elements, model, bodies, region)
        facets = source.faces[f"tie {k}"]
        on = gauss(source, facet_of(source), facets)
        places = np.einsum("mn,mna->ma", on.shares, source.points[on.supports])
        center = on.weights @ places / on.weights.sum()
        nodes = np.unique(facets)
        moment = np.cross(source.points[nodes] - center, nodal[nodes]).sum(axis=0)
        results.append(Carried(nodal[nodes].sum(axis=0), moment, center))
    return results
