"""What ties of parts of one solid carry: internal forces of the slave alone, at the nodes that it shares."""

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
    """What a tie carries, as in `isorod.checks.tie_result.TieResult`: on the slave, moments about ``center``."""

    force: Array
    moment: Array
    center: Array


def carried(solution: Solution, elements: Elements, rule: int, bodies: Sequence[OfBody]) -> list[Carried]:
    """Return what each tie carries at full load; ``rule`` is the degree of the energy's quadrature."""
    source, model = solution.mesh, solution.model
    shape = getattr(basix.CellType, source.shape)
    points, weights = (np.asarray(one) for one in basix.make_quadrature(shape, rule))
    found = []
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
        found.append(Carried(nodal[nodes].sum(axis=0), moment, center))
    return found
