"""The contacts of a model between the lateral surfaces of its mesh, or of one of these with a rigid obstacle."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from comparisons.fem.contact.facets import facet_of, gauss
from comparisons.fem.contact.obstacles import Obstacle
from comparisons.fem.contact.surfaces import Contact as Surfaces
from comparisons.fem.pressed import Pressed, Touching
from comparisons.fem.rods.elements import Elements
from comparisons.fem.rods.solution import Touch
from isorod.contact.defaults import penalty, smallest_radius
from isorod.errors import SolveError
from isorod.model.contact import Contact, Cylinder, Plane
from isorod.model.model import Model
from meshes.mesh import Index, Mesh

# Contact begins inside a facet, whose edges are therefore divided: parts are no longer than this fraction of the
# thinner rod's radius, within bounds on their number.
_LONGEST = 0.5
_FEWEST, _MOST = 3, 6

# Points of two rods that are farther apart than this fraction of that radius are not searched in every iteration.
_REACH = 0.5

# How deep contacts may be whose penalty was not given, in radii (`isorod.model.contact.Contact`).
_DEPTH = 1e-3

# A penalty rises by this factor, at most so many times.
_RISE, _MOST_RISES = 3.0, 15


class Contacts:
    """All contacts of a model.

    Attributes
    ----------
    all
        As `comparisons.fem.pressed.Pressed` takes them.
    """

    def __init__(self, elements: Elements, model: Model) -> None:
        self._model = model
        self.all: list[Touching] = [_made(elements, model, k) for k in range(len(model.contacts))]

    def outcome(self, newton: Pressed) -> Sequence[Touch]:
        """Return the outcome of each contact at the present state."""
        states = newton.press(newton.force)[: len(self.all)]
        return [Touch(one.normal_force, one.area, max(0.0, -one.gap)) for one in states if one is not None]

    def stiffen(self, newton: Pressed) -> int:
        """Raise penalties until no point is deeper than its contact allows, as in isorod; return how often."""
        for count in range(_MOST_RISES):
            depths = [touch.penetration for touch in self.outcome(newton)]
            deep = [k for k, most in enumerate(self._allowed()) if depths[k] > most]
            if not deep:
                return count
            for k in deep:
                self.all[k].penalty *= _RISE
            newton.norms.clear()
            newton.solve(newton.x.copy())
        raise SolveError(f"penetration does not fall to the allowed one in {_MOST_RISES} steps; raise the penalty")

    def _allowed(self) -> list[float]:
        """Return how deep each contact may be (`isorod.model.contact.Contact`)."""
        depths = []
        for contact in self._model.contacts:
            own = np.inf if contact.penalty is not None else _DEPTH * smallest_radius(self._model, contact)
            depths.append(own if contact.penetration is None else contact.penetration)
        return depths


def _made(elements: Elements, model: Model, k: int) -> Touching:
    contact, mesh = model.contacts[k], elements.source
    if contact.obstacle is not None:
        ((body, chosen),) = contact.sides
        facets = _facets(elements, model, body, chosen)
        parts = _parts(mesh, [facets], _radius(contact, elements))
        assert isinstance(contact.obstacle, Plane | Cylinder)
        return Obstacle(gauss(mesh, facet_of(mesh), facets, parts), contact.obstacle, penalty(model, contact))
    sides = {
        name: _facets(elements, model, body, chosen)
        for name, (body, chosen) in zip(("first", "second"), contact.sides, strict=True)
    }
    named: Mesh = replace(mesh, faces={**mesh.faces, **sides})
    radius = _radius(contact, elements)
    parts = _parts(mesh, [*sides.values()], radius)
    return Surfaces(named, "first", "second", penalty(model, contact), parts, _REACH * radius)


def _facets(elements: Elements, model: Model, body: int, chosen: Sequence[int] | None) -> Index:
    """Return the facets of a rod's lateral surface, or of some elements' of its space, ``(m, n)``."""
    mesh = elements.source
    facets = mesh.faces[f"rod {body} lateral"]
    if chosen is None:
        return np.asarray(facets)
    assert mesh.parameters is not None
    axis = model.bodies[body].space.axis
    u = mesh.parameters[facets, 2]
    low, high = axis.breaks[[0, -1]]
    beyond = (np.ptp(u, axis=1) > 0.5 * (high - low))[:, None] & (u < 0.5 * (low + high))
    middle = low + np.mod((u + (high - low) * beyond).mean(axis=1) - low, high - low)
    element = np.searchsorted(axis.breaks[1:-1], middle, side="right")
    return np.asarray(facets[np.isin(element, list(chosen))])


def _radius(contact: Contact, elements: Elements) -> float:
    """Return the smallest mean distance of a layer's control points from their middle, of the rods of a contact."""
    polygons = [elements.rods[body].control_points for body, _ in contact.sides]
    arms = [polygon - polygon.mean(axis=1, keepdims=True) for polygon in polygons]
    return min(float(np.linalg.norm(one, axis=2).mean(axis=1).min()) for one in arms)


def _parts(mesh: Mesh, faces: Sequence[Index], radius: float) -> int:
    """Return in how many parts to an edge the facets of some faces are cut."""
    corners = [mesh.points[facets][:, np.isin(mesh.face_reference, (0.0, 1.0)).all(axis=1)] for facets in faces]
    longest = max(float(np.ptp(one, axis=1).max(axis=1).mean()) for one in corners)
    return int(np.clip(np.ceil(longest / (_LONGEST * radius)), _FEWEST, _MOST))
