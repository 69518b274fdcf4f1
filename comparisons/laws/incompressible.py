"""Incompressible laws on the scenes: finite elements of displacement and pressure (Taylor-Hood) in dolfinx."""

from collections.abc import Callable
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from comparisons.fem import mixed
from comparisons.fem.domain import Domain
from comparisons.fem.statics import Held
from comparisons.laws.scenes import STEPS
from isorod.model import Model
from isorod.space import Space
from meshes.mesh import Array, Mesh


def solve(model: Model, mesh: Mesh) -> mixed.Equilibrium:
    """Return the equilibrium of a round rod's model, whose supports are those of its start and its end, on a mesh."""
    body = model.bodies[0]
    law: Any = body.laws[0]
    domain = Domain.distribute(mesh, MPI.COMM_SELF)
    ends = (0.0, 1.0)
    breaks = body.space.axis.breaks
    held = [
        Held(f"rod 0 {name}", _displacement(body.space, float(breaks[0] + end * np.ptp(breaks)), motion.at(1.0)))
        for name, end, motion in zip(("start", "end"), ends, model.motions, strict=True)
    ]
    fibres = (_tangent(domain, model),) if law.families else ()
    return mixed.solve(domain, law, held, steps=STEPS, fibres=fibres)


def _displacement(space: Space, u: float, coefficients: Array) -> Callable[[Array], Array]:
    """Return the displacement of places of a section ``(3, m)``, whose disk is mapped linearly to it."""
    centre, jacobian = (one[0, 0] for one in space.rod.grid([[0.0, 0.0]], [u]))
    to_disk = np.linalg.pinv(jacobian[:, :2])

    def displacement(x: Array) -> Array:
        xi = (x.T - centre) @ to_disk.T
        functions, _ = space.basis.functions(xi / np.maximum(1.0, np.linalg.norm(xi, axis=1, keepdims=True)))
        return np.asarray((functions @ coefficients.reshape(-1, 3)).T)

    return displacement


def _tangent(domain: Domain, model: Model) -> Any:
    """Return the direction of the centre line, straight along z or an arc about it."""
    _, jacobian = model.bodies[0].space.rod.grid([[0.0, 0.0]], model.bodies[0].space.axis.breaks[[0, -1]])
    if abs(jacobian[0, 0, 2, 2]) > 0.0:
        return ufl.as_vector((0.0, 0.0, 1.0))
    x = ufl.SpatialCoordinate(domain.mesh)
    return ufl.as_vector((-x[1], x[0], 0.0)) / ufl.sqrt(x[0] ** 2 + x[1] ** 2)
