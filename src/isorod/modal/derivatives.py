"""Derivatives of frequencies by parameters of the model.

``d lambda = x^T (dK - lambda dM) x``, ``x^T M x = 1``; for multiple eigenvalues, as of round rods, the derivatives are
the eigenvalues of that matrix over all modes of the frequency.  ``dK`` is the total change of the stiffness, with that
due to the equilibrium which modes are about (`isorod.statics.derivatives`).
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from petsc4py import PETSc
from scipy.linalg import eigh

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import is_mixed
from isorod.assembly.formulation import assembler_for
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.statics.derivatives import Moving, numbers, refuse
from isorod.statics.differences import BY, WIDE, Derivatives, Kinked, Measured, PerturbedModels, Steps, Unavailable

# Relative distance up to which frequencies count as multiple: discrete round rods split theirs by less.
_SAME = 1e-5


def derivatives(
    solution: Any,
    make: Callable[[Mapping[str, float]], Model],
    at: Mapping[str, float],
    measure: Callable[[Any], Mapping[str, object]],
) -> Derivatives:
    """Return the derivatives of measures of modes, as `isorod.statics.derivatives.derivatives` does.

    Modes of one frequency get the derivatives of those combinations that stay modes, ascending.

    Raises
    ------
    InputError
        As there; or if the body spins, the formulation is mixed, or the state is unstable.
    """
    model = solution.model
    refuse(model)
    if model.remembers or model.times is not None:
        raise Unavailable("derivatives: not available for modes about a state over time, or of laws with memory")
    if solution.quarter is not None or is_mixed(model):
        raise Unavailable("derivatives: not available for modes with a spin or of the mixed formulation")
    first = solution.rigid
    values = solution.eigenvalues[first:]
    if (values <= 0.0).any():
        raise InputError("derivatives: the state is unstable: its frequencies are none")
    with ExitStack() as stack:
        beside = PerturbedModels(make, at, model)
        moving = None if solution.equilibrium is None else stack.enter_context(closing(Moving(solution.equilibrium)))
        comm = PETSc.COMM_SELF if solution.ranks == 1 else PETSc.COMM_WORLD

        def states(steps: Steps, models: Sequence[Model]) -> "list[tuple[Assembler, PETSc.Vec]]":
            if moving is None:
                several = [assembler_for(one, comm) for one in models]
                return [(one, one.vector()) for one in several]
            motion, known = moving.motion(steps, models)
            moved = [(one, moving.x + step * motion.rate) for (one, _), step in zip(known, steps.steps, strict=True)]
            for (assembler, x), step in zip(moved, steps.steps, strict=True):
                if pressed is not None and not np.array_equal(
                    hold_beside(assembler, x, step * motion.pressures), pressed
                ):
                    raise Kinked("points come into contact, or leave it")
            return moved

        factor = 0.0 if moving is None else 1.0
        start = assembler_for(model, comm) if moving is None else moving.perturbed(model)
        pressed = None
        if moving is not None and model.contacts:
            from isorod.modal.touching import hold_beside

            pressed = hold_beside(start, moving.x, 0.0)
        # Scaled so that all have the same weight.
        shapes = [
            start.state(vector / np.sqrt(value)) for vector, value in zip(solution.vectors[first:], values, strict=True)
        ]

        # Internal forces are rounded alike on models nearby, entries of matrices are not.
        exact = moving is None and not model.coupled and all(body.linear for body in model.bodies)

        def energies(assembler: Assembler, x: PETSc.Vec) -> Measured:
            products = {"mass": np.sqrt(np.outer(values, values)) * assembler.mass_products(shapes, solution.lumped)}
            if exact:
                return products | {
                    "stiffness": _products(lambda one, out: assembler.residual(one, factor, out), shapes)
                }
            stiffness = assembler.matrix()
            assembler.tangent(x, factor, stiffness)
            products["stiffness"] = _products(stiffness.mult, shapes)
            stiffness.destroy()
            return products

        begun = energies(start, start.vector() if moving is None else moving.x)

        def along(steps: Steps, models: Sequence[Model]) -> Measured:
            return steps.slopes([energies(*one) for one in states(steps, models)], begun)

        # With larger steps other points come into contact.
        sizes = [BY] if model.contacts else [BY, WIDE] if exact else [WIDE]
        changes = beside.derivatives(
            begun,
            along,
            sizes,
            lambda several: [partial(dict, one) for one in several],
        )
    by = {}
    for name in changes.by:
        rates, turn = _rates(values, changes.by[name])
        shape = solution.vectors.copy()
        shape[first:] = turn.T @ shape[first:]
        by[name] = _measured(solution, shape, rates, measure)
    return Derivatives(dict(at), numbers(measure(solution)), by, changes.none)


def _products(times: "Callable[[PETSc.Vec, PETSc.Vec], object]", shapes: "Sequence[PETSc.Vec]") -> Array:
    """Return ``x^T A y`` of all pairs of shapes; ``times`` fills its second argument with ``A`` times the first."""
    products = np.zeros((len(shapes), len(shapes)))
    image = shapes[0].duplicate()
    for k, shape in enumerate(shapes):
        times(shape, image)
        products[k] = [image.dot(other) for other in shapes]
    return 0.5 * (products + products.T)


def _rates(values: Array, change: Measured) -> tuple[Array, Array]:
    """Return the relative rates of eigenvalues, and in columns the combinations of shapes that have them."""
    matrix = change["stiffness"] - change["mass"]
    rates, turn = np.zeros(values.size), np.eye(values.size)
    apart = np.flatnonzero(np.diff(values) > _SAME * values[1:]) + 1
    for group in np.split(np.arange(values.size), apart):
        block = np.ix_(group, group)
        rates[group], turn[block] = eigh(0.5 * (matrix[block] + matrix[block].T))
    return rates, turn


def _measured(solution: Any, shapes: Array, rates: Array, measure: Callable[[Any], Mapping[str, object]]) -> Measured:
    """Return the derivatives of measures from relative rates of the flexible eigenvalues."""
    step = 1e-3 / (np.abs(rates).max() or 1.0)
    ends = []
    for change_by in (-step, step):
        # The relative change of a frequency is half that of its eigenvalue.
        change = np.concatenate([np.zeros(solution.rigid), 0.5 * change_by * rates])
        moved = replace(
            solution,
            frequencies=solution.frequencies * (1.0 + change),
            eigenvalues=solution.eigenvalues * (1.0 + 2.0 * change),
            vectors=shapes,
        )
        ends.append(numbers(measure(moved)))
    return {name: (ends[1][name] - ends[0][name]) / (2.0 * step) for name in ends[0]}
