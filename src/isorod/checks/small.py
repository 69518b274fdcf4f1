"""Small-strain laws: warnings where rotations or strains exceed their range."""

import warnings
from collections.abc import Sequence

import numpy as np

from isorod.arrays import Array
from isorod.assembly.gradients import displacement_gradients
from isorod.material.law import Material
from isorod.model import Model
from isorod.model.motion import SupportMotion
from isorod.model.tie import SolidSurface
from isorod.tensors import turning

# Largest component of the displacement gradient: a rotation by so many radians gives a spurious strain of 0.5 %.
LARGE = 0.1

# Spurious strain by rotation from which to warn, relative to the largest strain.
_FALSE = 0.005


def warn_of_large(model: Model, displacements: Array, solids: Sequence[Sequence[Array]] = ()) -> None:
    """Warn of bodies whose rotations or strains exceed the range of their small-strain laws.

    Parameters
    ----------
    model
        The model.
    displacements
        All degrees of freedom at outputs, shape ``(outputs, dofs)``.
    solids
        For each output, displacements of solids on this rank (`isorod.output.state.State.solids`); collective.
    """
    checked = []
    cure = "use a finite-strain law such as StVenantKirchhoff or OrthotropicKirchhoff"
    for b, body in enumerate(model.bodies):
        small = next((law for law in body.laws if not law.objective), None)
        if small is None:
            continue
        table = body.space.tabulate(0, body.space.axis.elements)
        shape = (table.elements, body.space.axis.degree + 1, body.space.layer_nodes, 3)
        largest = strained = turned = 0.0
        for row in displacements:
            nodal = model.nodal(row, b)[body.space.element_nodes].reshape(shape)
            gradients = displacement_gradients(table, nodal)
            largest = max(largest, float(np.abs(gradients).max()))
            strained = max(strained, 0.5 * float(np.abs(gradients + np.swapaxes(gradients, -1, -2)).max()))
            skew = 0.5 * (gradients - np.swapaxes(gradients, -1, -2))
            turned = max(turned, 0.5 * float(np.square(skew).sum(axis=-2).max()))
        other = next((law for law in _beside(model, b) if law.objective), None)
        if other is not None and turned > _FALSE * strained and largest <= LARGE:
            warnings.warn(
                f"rotations of body {b} reach {(2.0 * turned) ** 0.5:.2g}, which the small-strain law "
                f"{type(small).__name__} takes for a strain of {turned:.2g}, "
                f"{100.0 * turned / strained:.2g} % of the largest, and "
                f"{type(other).__name__}, joined to it, does not; {cure}",
                stacklevel=3,
            )
        checked.append((f"body {b}", small, largest))
        for k, (support, motion) in enumerate(zip(model.supports, model.motions, strict=True)):
            false = _false_strain(motion) if support.body == b else 0.0
            if false > _FALSE * strained and largest <= LARGE:
                warnings.warn(
                    f"support {k}: its face turns by {np.degrees(motion.farthest):.4g} degrees, which the small-strain "
                    f"law {type(small).__name__} takes for a strain of {false:.2g}, {100.0 * false / strained:.2g} % "
                    f"of the largest; {cure}",
                    stacklevel=3,
                )
    for k, solid in enumerate(model.solids):
        if solid.law is not None and not solid.law.objective:
            checked.append((f"solid {k}", solid.law, max(solid.largest_gradient(row[k]) for row in solids)))
    for which, law, largest in checked:
        if largest > LARGE:
            warnings.warn(
                f"rotations or strains of {which} reach {largest:.2g}, the small-strain law {type(law).__name__} "
                f"needs less than {LARGE:g}; {cure}",
                stacklevel=3,
            )


def _beside(model: Model, body: int) -> list[Material]:
    """Return the laws of a body and of bodies tied to it."""
    laws = list(model.bodies[body].laws)
    for tie in model.ties:
        sides = tie.slave, tie.master
        for side, other in (sides, sides[::-1]):
            if getattr(side, "body", None) != body:
                continue
            if isinstance(other, SolidSurface):
                law = model.solids[other.solid].law
                laws += [] if law is None else [law]
            else:
                laws += model.bodies[other.body].laws
    return laws


def _false_strain(motion: SupportMotion) -> float:
    """Return the largest spurious small strain by the rotation of a support, whose nodes move along arcs."""
    size = float(np.linalg.norm(motion.arms, axis=1).max(initial=0.0))
    turn = motion.turn * (motion.farthest / (float(np.linalg.norm(motion.turn)) or 1.0))
    rows = 0.5 * (turning(turn) + turning(-turn))[motion.dofs % 3]
    return float(np.abs(np.sum(rows * motion.arms, axis=1)).max(initial=0.0)) / size if size else 0.0
