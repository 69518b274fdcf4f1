"""Vibration modes of rods about their state of rest: `comparisons.fem.modal` with laws and densities by cell."""

from time import perf_counter
from typing import Any

import numpy as np

from comparisons.fem import modal
from comparisons.fem.known import with_pressures
from comparisons.fem.pressed import add_rows, rows_of
from comparisons.fem.rods.elements import Elements
from comparisons.fem.rods.laws import Laws
from comparisons.fem.rods.means import RIGID, means_of
from comparisons.fem.rods.solution import Solution
from comparisons.fem.rods.supports import Supports
from comparisons.fem.rods.task import Task
from isorod.assembly.mass import refuse_massless
from isorod.checks.rigid_motions import free_motions
from isorod.fenics import compat
from isorod.model.model import Model
from meshes.mesh import Array


def solve(task: Task, modes: int) -> Solution:
    """Return the lowest modes, see `comparisons.fem.rods.solve`; loads, spin and contacts have no part in them."""
    model = task.model
    refuse_massless(model.bodies, "modes need")
    begin = perf_counter()
    elements = task.elements(with_pressures(model))
    laws, supports = Laws(elements, model, task.rule), Supports(elements, model, task.bodies)
    settings = modal.Settings(modal.DIRECT if task.options is None else task.options, task.flags)
    body = _body(elements, model, laws, supports, settings)
    result = modal.lowest(body, modes, len(free_motions(model)), settings, begin)
    return Solution(
        model=model,
        mesh=task.mesh,
        analysis="modal",
        cell_parameters=elements.parameters,
        place=laws.place,
        seconds=result.seconds,
        dofs=result.dofs,
        unknowns=result.unknowns,
        options=result.options,
        peak_memory=result.peak_memory,
        iterations={"iterations": result.iterations},
        frequencies=result.frequencies,
        eigenvalues=result.eigenvalues,
        residuals=result.residuals,
        shapes=_shapes(elements, result),
        rigid=result.rigid,
        below=result.below,
        bodies=task.bodies,
    )


def _body(elements: Elements, model: Model, laws: Laws, supports: Supports, settings: modal.Settings) -> modal.Body:
    free = np.setdiff1d(np.arange(elements.own), supports.held)
    if supports.whole:
        free = free[::3] // 3
    source, (u, pressure) = elements.source, elements.split
    means = [*means_of(elements, model, laws.unit, RIGID).values()]
    more: dict[str, Any] = {"whole": supports.whole}
    if pressure is not None:
        more = {"whole": False, "pressures": elements.dofs - 3 * len(source.points)}
    if means:

        def bonds(matrix: Any) -> None:
            add_rows(matrix, rows_of([one.stiffness(source.points) for one in means], elements.numbers, matrix))

        more["bonds"] = bonds
    scalar = None
    if pressure is None and not means:
        component = compat.element(elements.mesh, "Lagrange", source.order, 1, equispaced=True)
        scalar = compat.function_space(elements.mesh, component)
    given = elements.state, u, laws.at_rest(), laws.density, scalar, free, source.order, settings
    return modal.Body(*given, **more)


def _shapes(elements: Elements, result: modal.Modes) -> Array:
    """Return mode shapes at the nodes, shape ``(modes, nodes, 3)``."""

    def nodal(shape: Any) -> Array:
        result.carry(shape)
        return elements.to_nodes(elements.state.x.array).copy()

    return np.array([nodal(shape) for shape in result.shapes])
