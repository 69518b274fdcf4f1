"""Loads on the nodes of a mesh: dead ones as nodal forces, those that change with the displacement as forms."""

from collections.abc import Sequence
from typing import Any

import dolfinx.fem
import dolfinx.mesh
import numpy as np
import ufl

from comparisons.fem.contact.facets import facet_of, gauss, outward
from comparisons.fem.rods.elements import Elements
from comparisons.fem.rods.laws import Laws, densities_of
from comparisons.fem.rods.places import on_rod
from isorod.errors import InputError
from isorod.fenics.loads import Load
from isorod.files.solid import OfBody
from isorod.geometry.quadrature import Rule, section_points
from isorod.model.load import BodyForce, LineLoad, Pressure, SectionLoad, Spin, Weight
from isorod.model.model import Model
from meshes.mesh import Array, Index, gradients
from meshes.mesh import gauss as volume_rule
from meshes.within import lagrange

# Points of a section at which its area is integrated.
_SECTION = Rule(6, 4, 1)

_SURFACES = {"outer": "lateral", "inner": "inner"}


def dead(elements: Elements, model: Model, bodies: Sequence[OfBody] = (), region: str | None = None) -> Array:
    """Return the nodal forces at full load of loads that do not depend on the displacement, shape ``(nodes, 3)``.

        Parameters
        ----------
        bodies
            What loads the model's bodies.
        region
    Only loads of this region, ``"rod 0"`` ..., ``"solid 0"`` ...; of all if None.

        Raises
        ------
        InputError
            If a load is not known, or on a section within cells.
    """
    result = np.zeros_like(elements.source.points)
    for load in model.loads:
        if region in (None, f"rod {load.body}"):
            result += nodal(elements, model, load)
    for k, body in enumerate(bodies):
        if region in (None, f"solid {k}"):
            for one in body.loads:
                _add(elements, k, one, result)
    return result


def nodal(elements: Elements, model: Model, load: Any) -> Array:
    """Return the nodal forces at full load of a rod's load; zero where it depends on the displacement."""
    result, source = np.zeros_like(elements.source.points), elements.source
    if isinstance(load, SectionLoad):
        breaks = model.bodies[load.body].space.axis.breaks
        facets = elements.section(load.body, float(breaks[-1] if load.u is None else load.u))
        points = gauss(source, facet_of(source), facets)
        functions = points.shares * (points.weights / points.weights.sum())[:, None]
        pull = np.tile(np.array(load.force or (0.0, 0.0, 0.0), dtype=float), (len(points.weights), 1))
        if load.moment is not None and load not in model.following:
            places = np.einsum("qn,qna->qa", points.shares, source.points[points.supports])
            pull += _turning(places, points.weights, load.moment)
        np.add.at(result, points.supports, functions[:, :, None] * pull[:, None])
    elif isinstance(load, Weight):
        cells = elements.cells(load.body)
        result += _volumes(elements, cells, densities_of(elements, model)[cells])[:, None] * np.array(load.acceleration)
    elif isinstance(load, BodyForce):
        result += _volumes(elements, elements.cells(load.body))[:, None] * np.array(load.density)
    elif isinstance(load, LineLoad):
        result += _along(elements, load)
    elif isinstance(load, Pressure) and not load.follows:
        facets, like = source.faces[_face(elements, load)], facet_of(source)
        points, areas = gauss(source, like, facets), outward(source, like, facets)
        np.add.at(result, points.supports, -load.pressure * points.shares[:, :, None] * areas[:, None])
    return result


def _along(elements: Elements, load: LineLoad) -> Array:
    """Return the nodal forces of a force per length of the centre line, ``int N_i q dA / A ds``, in parameters."""
    source, rod, cells = elements.source, elements.rods[load.body], elements.cells(load.body)
    where, weights = volume_rule(source.shape, 4 * source.order)
    slopes, values = (
        gradients(source.shape, source.order, source.reference, where),
        lagrange(source.order, source.reference, where),
    )
    own = elements.parameters[cells]
    det = np.abs(np.linalg.det(np.einsum("qnb,cnp->cqpb", slopes, own)))
    places = on_rod(rod, np.einsum("qn,cnp->cqp", values, own))
    where = places.u.ravel()
    pulls = np.cross(*np.moveaxis(rod.across(places.xi.reshape(-1, 2), where)[1], -1, 0))
    # Sections and speeds differ along the rod alone.
    u, back = np.unique(np.round(where, 12), return_inverse=True)
    xi, area = section_points(rod.section_points, _SECTION, rings=rod.rings)
    _, jacobian = rod.grid(xi, u)
    areas = np.linalg.norm(np.cross(jacobian[..., 0], jacobian[..., 1]), axis=-1) @ area
    speed = np.linalg.norm(rod.grid(np.zeros((1, 2)), u)[1][:, 0, :, 2], axis=-1)
    density = np.linalg.norm(pulls, axis=-1) * (speed / areas)[back.ravel()]
    lengths = (det * weights * density.reshape(det.shape)) @ values
    # Cells do not fill the disk to the last digit, and the force is known.
    lengths *= np.ptp(rod.arc_length(rod.axis.breaks)) / lengths.sum()
    nodal_lengths = np.bincount(source.cells[cells].ravel(), lengths.ravel(), len(source.points))
    return nodal_lengths[:, None] * np.array(load.per_length)


def _add(elements: Elements, solid: int, load: Load, result: Array) -> None:
    """Add a load on a body to nodal forces."""
    source = elements.source
    if load.group is None:
        result += _volumes(elements, source.regions[f"solid {solid}"])[:, None] * np.array(load.vector)
        return
    facets, like = source.faces[f"solid {solid} {load.group}"], facet_of(source)
    points = gauss(source, like, facets)
    if load.pressure:
        pull = -load.pressure * outward(source, like, facets)
    else:
        area = points.weights.sum() if load.total else 1.0
        pull = points.weights[:, None] * np.array(load.vector) / area
    np.add.at(result, points.supports, points.shares[:, :, None] * pull[:, None])


def _turning(places: Array, weights: Array, moment: tuple[float, float, float]) -> Array:
    """Return the traction of a moment times the area, at rest (`isorod.model.load.SectionLoad`), ``(m, 3)``."""
    arms = places - weights @ places / weights.sum()
    spread = (weights[:, None] * arms).T @ arms
    turn = np.linalg.solve(spread.trace() * np.eye(3) - spread, moment)
    return np.asarray(weights.sum() * np.cross(turn, arms))


def _face(elements: Elements, load: Pressure) -> str:
    name = f"rod {load.body} {_SURFACES[load.surface]}"
    if name not in elements.source.faces:
        raise InputError(f"pressure on the {load.surface} surface: the mesh has no face {name!r}")
    return name


def _volumes(elements: Elements, cells: Index, densities: Array | float = 1.0) -> Array:
    """Return the integrals of the nodes' functions over some cells, ``(nodes,)``, times a number of each cell."""
    source = elements.source
    where, weights = volume_rule(source.shape, 4 * source.order)
    slopes = gradients(source.shape, source.order, source.reference, where)
    values = lagrange(source.order, source.reference, where)
    det = np.linalg.det(np.einsum("qnb,cna->cqab", slopes, source.points[source.cells[cells]]))
    integrals = np.reshape(densities, (-1, 1)) * ((det * weights) @ values)
    nodes = source.cells[cells].ravel()
    return np.asarray(np.bincount(nodes, integrals.ravel(), len(source.points)), dtype=float)


def centrifugal(laws: Laws, spin: Spin, u: Any) -> Any:
    """Return the potential of a spin's force at full load: an integral."""
    mesh = laws.elements.mesh
    field, centre = (dolfinx.fem.Constant(mesh, np.array(value, dtype=float)) for value in (spin.field, spin.center))
    arm = ufl.SpatialCoordinate(mesh) + u - centre
    density = -0.5 * laws.density * ufl.inner(arm, field * arm)
    return sum(density * laws.dx(kind) for kind in laws.present)


class Following:
    """Pressures that follow surfaces: the force with which the body resists them, in UFL.

    ``p int cof(F) N . v dA``, integrals over the surfaces at rest.

    Attributes
    ----------
    work
        Virtual work at full load; None if there are none.
    """

    def __init__(self, elements: Elements, model: Model, rule: int, u: Any, test: Any) -> None:
        self._loads = [load for load in model.following if isinstance(load, Pressure)]
        self._sizes = [dolfinx.fem.Constant(elements.mesh, load.pressure) for load in self._loads]
        self.work = self._work(elements, rule, u, test) if self._loads else None

    def at(self, begin: float, end: float) -> None:
        """Set them to their means over an interval, or to their values at a time."""
        for size, load in zip(self._sizes, self._loads, strict=True):
            size.value = load.pressure * load.factor(begin, end)

    def _work(self, elements: Elements, rule: int, u: Any, test: Any) -> Any:
        facets, tags = [], []
        for k, load in enumerate(self._loads):
            facets.append(elements.facets(_face(elements, load)))
            tags.append(np.full(len(facets[k]), k, dtype=np.int32))
        where, first = np.unique(np.concatenate(facets), return_index=True)
        if len(where) != sum(len(one) for one in facets):
            raise InputError("pressure: two that follow the same surface; add them up")
        regions = dolfinx.mesh.meshtags(elements.mesh, 2, where, np.concatenate(tags)[first])
        ds = ufl.Measure("ds", domain=elements.mesh, subdomain_data=regions, metadata={"quadrature_degree": rule})
        F = ufl.Identity(3) + ufl.grad(u)
        normal = ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(elements.mesh)
        return sum(size * ufl.inner(normal, test) * ds(k) for k, size in enumerate(self._sizes))
