"""Checks of a law when it is made: a failure is reported in one line, with its magnitude."""

from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.material.law import Material, plane_waves
from isorod.material.places import alone

# Strains at which it is evaluated, and a strain so small that cancellation would show.
_STRAIN, _SMALL = 0.08, 1e-8

_CHECKED: set[Any] = set()


def prove(law: Material, prestressed: bool) -> None:
    """Check a law at rest and at strains of some percent.

    Raises
    ------
    InputError
        If it has no value at rest or at strains of some percent; a rotation changes its energy; it has a stress at rest
        and is not prestressed; a plane wave at rest has no positive modulus; its stress at strains of 1e-8 is rounding.
    """
    placed = law.shear.placed(alone())
    key = law.stored, placed.constants.tobytes(), prestressed
    if key in _CHECKED:
        return
    F = np.eye(3) + _STRAIN * np.random.default_rng(1).uniform(-1.0, 1.0, (8, 3, 3))
    if not (np.isfinite(placed.stress(F)).all() and np.isfinite(placed.energy(F)).all()):
        raise InputError(f"energy: NaN at strains of {_STRAIN:g}")
    scale = float(np.abs(placed.tangent(np.eye(3)[None])).max())
    if not 0.0 < scale < np.inf:
        raise InputError(f"energy: its largest second derivative at rest is {scale:g}, need a finite one, not zero")
    _objective(placed, F, scale)
    if not prestressed:
        _free_at_rest(law, placed, scale)
    check_waves("energy", placed, scale)
    _exact_when_small(placed)
    _CHECKED.add(key)


def check_waves(name: str, law: Material, scale: float) -> None:
    """Check that plane waves at rest have positive moduli, relative to the largest modulus ``scale``."""
    waves = float(plane_waves(law).min()) if 0.0 < scale < np.inf else np.nan
    if not waves > 1e-12 * scale:
        raise InputError(f"{name}: not elliptic at rest: the least modulus of plane waves is {waves:.4g}")


def _objective(law: Material, F: Array, scale: float) -> None:
    """Check that rotations do not change the energy."""
    turned = _rotation()
    before, after = law.energy(F), law.energy(turned @ F)
    change = float(np.abs(after - before).max() / (scale * _STRAIN**2))
    if not change < 1e-8:
        raise InputError(f"energy: not objective: a rotation changes it by {100.0 * change:.3g} %")


def _free_at_rest(law: Material, placed: Material, scale: float) -> None:
    """Check that there is no stress at rest."""
    stress = placed.stress(np.eye(3)[None])[0]
    size = float(np.abs(stress).max())
    if size <= 1e-10 * scale:
        return
    pressure = float(np.trace(stress)) / 3.0
    if float(np.abs(stress - pressure * np.eye(3)).max()) <= 1e-10 * scale:
        what = f"a pressure of {-pressure:.6g}; with a bulk modulus it is made up for, or add {-pressure:.6g} log(J)"
    else:
        what = f"{size:.6g}"
    raise InputError(f"energy: not free of stress at rest, there is {what}; if that is meant: prestressed=True")


def _exact_when_small(law: Material) -> None:
    """Check that the stress at tiny strains is not rounding."""
    direction = _STRAIN * np.random.default_rng(2).uniform(-1.0, 1.0, (3, 3))
    rest = np.eye(3)[None]
    moved = rest + _SMALL * direction
    # Halfway: at rest tension-only fibres may be slack or taut.
    linear = np.einsum("aAbB,bB->aA", law.tangent(rest + 0.5 * _SMALL * direction)[0], direction)
    difference = (law.stress(moved) - law.stress(rest))[0] / _SMALL
    error = float(np.abs(difference - linear).max() / np.abs(linear).max())
    if not error < 1e-5:
        raise InputError(f"energy: its stress at strains of {_SMALL:g} is off by {100.0 * error:.3g} %: cancellation")


def _rotation() -> Array:
    """Return a rotation about no particular axis."""
    q, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    return np.asarray(q * np.linalg.det(q))
