"""The excitation, by loads or the base, and the static model about whose state responses are."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.formulation import assembler_for
from isorod.errors import InputError, expect, finite, whole_number
from isorod.material.linear_elastic import LinearElastic
from isorod.material.viscous import Viscoelastic
from isorod.model.load import Weight
from isorod.model.model import Model

# Fraction by which shear moduli are reduced to obtain their stiffness, which is linear in them.
_PART = 0.5


@dataclass(frozen=True, eq=False)
class Drive:
    """An excitation.

    Attributes
    ----------
    still
        The model with the static loads.
    swinging
        The model with the oscillating loads instead; for base excitation inertia in the frame that moves with the base.
    base
        Amplitude of the supports' acceleration or, if ``by_square``, displacement, shape ``(3,)``; else zeros.
    soft
        Prony series of viscoelastic bodies, by their number (`relaxing`).
    """

    still: Model
    swinging: Model
    base: Array
    by_square: bool
    soft: Mapping[int, Array]

    def forces(self, assembler: Assembler, x: PETSc.Vec, factor: float) -> PETSc.Vec:
        """Return the amplitude of the forces on the unknowns of a state."""
        own = assembler_for(self.swinging, assembler.comm) if self.swinging.following else assembler
        out = assembler.vector()
        own.load(self.swinging, x, factor, out)
        if not out.norm() > 0.0:
            raise InputError("loads: what swings moves nothing: its forces are zero, or on supports alone")
        return out


def driven(
    model: Model,
    base: tuple[float, float, float] | None,
    base_displacement: tuple[float, float, float] | None,
    loads: Sequence[int] | None,
) -> Drive:
    """Return the excitation of a model, by the arguments of `isorod.harmonic.solve`; raises `InputError`."""
    if model.contacts:
        raise InputError("contact 0: a response is linear, and contact opens and closes; leave it out, or use dynamics")
    if model.solids:
        raise InputError("solid 0: harmonic response is not available with finite element bodies; use dynamics")
    shaken = base_displacement if base is None else base
    name = "base" if base is not None else "base_displacement"
    if base is not None and base_displacement is not None:
        raise InputError("base_displacement: beside base; need one of the two")
    if shaken is not None:
        expect(name, shaken, tuple[float, float, float])
        finite(name, shaken, "finite components")
        if not any(shaken):
            raise InputError(f"{name}: got zeros, need an amplitude")
        if model.spin is not None and any(model.spin.velocity):
            raise InputError(f"{name}: the frame turns with the spin, in which shaken supports go round; give loads")
    if loads is None:
        swing = [] if shaken is not None else [k for k, one in enumerate(model.loads) if not isinstance(one, Weight)]
    else:
        swing = [whole_number("loads", k, 0, len(model.loads) - 1) for k in loads]
    if shaken is None and not swing:
        raise InputError("nothing swings: give a load, or base, the acceleration of the supports")
    if shaken is not None and swing:
        raise InputError(f"loads: beside {name}; either supports are shaken or loads swing")
    forces = [one for k, one in enumerate(model.loads) if k in swing]
    if shaken is not None:
        sign = 1.0 if base_displacement is not None else -1.0
        forces = [
            Weight(tuple(float(sign * one) for one in shaken), body, b)  # type: ignore[arg-type]
            for b, body in enumerate(model.bodies)
        ]
    with warnings.catch_warnings():
        # The model itself has given these warnings.
        warnings.simplefilter("ignore")
        still = replace(model, loads=[one for k, one in enumerate(model.loads) if k not in swing]) if swing else model
        swinging = replace(model, loads=forces)
    moved = np.zeros(3) if shaken is None else np.array(shaken, dtype=float)
    return Drive(still, swinging, moved, base is None and shaken is not None, relaxing(model))


def relaxing(model: Model) -> dict[int, Array]:
    """Return the Prony series of viscoelastic bodies, rows of fraction and time, by their number.

    Raises
    ------
    InputError
        If another law has memory, or a body has several series.
    """
    prony: dict[int, Array] = {}
    for b, body in enumerate(model.bodies):
        other = next((law for law in body.laws if law.remembers and not isinstance(law, Viscoelastic)), None)
        if other is not None:
            raise InputError(
                f"body {b}: {type(other).__name__} is not linear for small stresses; harmonic response is "
                "available for elastic laws and Viscoelastic"
            )
        series = {np.asarray(law.prony, dtype=float).tobytes() for law in body.laws if isinstance(law, Viscoelastic)}
        if not series:
            continue
        if len(series) > 1 or not all(isinstance(law, Viscoelastic) for law in body.laws):
            raise InputError(
                f"body {b}: its laws have different Prony series; harmonic response needs the same series for all"
            )
        if body.formulation != "displacement":
            raise InputError(f"body {b}: viscoelastic in the mixed formulation; take nu up to 0.48, or use dynamics")
        prony[b] = np.frombuffer(series.pop()).reshape(-1, 2)
    return prony


def shear_stiffness(model: Model, number: int, comm: PETSc.Comm) -> PETSc.Mat:
    """Return the part of the stiffness at rest due to a body's shear moduli."""
    first, matrix = (_stiffness(model, number, fraction, comm) for fraction in (1.0, 1.0 - _PART))
    first.axpy(-1.0, matrix, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
    first.scale(1.0 / _PART)
    matrix.destroy()
    return first


def _stiffness(model: Model, number: int, fraction: float, comm: PETSc.Comm) -> PETSc.Mat:
    """Return the stiffness at rest with a fraction of a body's shear moduli and its full bulk moduli."""

    def softer(law: Any) -> Any:
        if isinstance(law, Sequence):
            return [softer(one) for one in law]
        mu, bulk = fraction * law.mu, law.lame + 2.0 / 3.0 * law.mu
        return LinearElastic(
            E=9.0 * bulk * mu / (3.0 * bulk + mu), nu=(3.0 * bulk - 2.0 * mu) / (6.0 * bulk + 2.0 * mu)
        )

    bodies = [*model.bodies]
    own = bodies[number]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        bodies[number] = replace(own, material=softer(own.material), formulation="displacement")
        assembler = assembler_for(replace(model, bodies=bodies), comm)
    matrix = assembler.matrix()
    assembler.tangent(assembler.vector(), 0.0, matrix)
    return matrix
