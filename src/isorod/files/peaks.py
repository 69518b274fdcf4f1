"""Stress at a place, or the largest and where it is."""

import warnings
from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.output import balance, held
from isorod.output.largest import Largest, Peak, largest
from isorod.output.state import State
from isorod.output.stress import component
from isorod.output.words import Component

# A stress is that of an edge if farther from it, by the width of the section, it is so much smaller; and, at a point
# that was asked for, if the point is so near, in parts of that width, to a held face.
_LARGER, _NEAR = 1.01, 0.05

# Part of that width from which on a length `away` that is given keeps off edges.
_FAR = 0.1

# A component that is a smaller share of von Mises' stress is nothing to be warned of.
_NOTHING = 1e-3

# Share of the stress from which what is out of balance is warned of.
LARGE = 0.03


def stress(
    state: Any,
    rod: int,
    name: Component,
    u: float | None,
    xi: tuple[float, float] | None,
    away: float | None,
) -> float | Peak:
    """Return what `isorod.files.measures.stress` does, of one state."""
    if away is not None and not away >= 0.0:
        raise InputError(f"away: got {away:g}, need a length, not negative")
    if away is not None and u is not None:
        raise InputError("away: it goes with the largest along a rod, and not with a place u")
    if xi is not None and np.hypot(*xi) > 1.0 + 1e-9:
        raise InputError(f"xi: got {list(xi)}, need a point of the unit disk")
    if u is not None and xi is not None:
        return float(_values(state, rod, name, np.array([u]), np.array([xi]))[0, 0])
    found = _largest(state, rod, name, u, xi, away or 0.0)
    if not np.isfinite(found.value):
        raise InputError(f"away: got {away:g}, but no point of the rod is that far from all supports")
    angle, radius = np.degrees(np.arctan2(*found.xi[::-1])), np.hypot(*found.xi)
    value = _values(state, rod, name, np.array([found.u]), found.xi[None])[0, 0]
    return Peak(float(value), {"u": found.u, "angle": float(angle) % 360.0, "radius": float(radius)})


def warn(
    state: Any,
    rod: int,
    name: Component,
    u: float | None,
    xi: tuple[float, float] | None,
    away: float | None,
    found: float | Peak,
) -> None:
    """Warn of a stress that is one of an edge, or out of balance."""
    if isinstance(found, Peak):
        place, angle = found.place["u"], np.radians(found.place["angle"])
        disk = found.place["radius"] * np.array([np.cos(angle), np.sin(angle)])
    else:
        assert u is not None and xi is not None
        place, disk = u, np.array(xi)
    if abs(found.value if isinstance(found, Peak) else found) <= _NOTHING * _values(
        state, rod, "von_mises", np.array([place]), disk[None]
    ):
        return
    gap, width = held.distance(state.model, rod, np.array([place]))[0], held.width(state.model, rod)
    # Whoever says how far off it is to be knows of the edge, if that is not next to nothing.
    if isinstance(found, Peak) and u is None and gap < (_FAR if away else 1.0) * width:
        beyond = _largest(state, rod, name, None, xi, width).value
        if found.value * (-1.0 if name == "min_principal" or found.value < 0.0 else 1.0) > _LARGER * beyond:
            known = f"; farther off than the section is wide (away = {width:.3g}) it is {beyond:.4g}"
            _say(
                f"largest {_words(name)} {found.value:.4g} is {gap:.2g} from the edge of a held face or patch, a "
                f"stress singularity that grows without bound under refinement{known if np.isfinite(beyond) else ''}"
            )
            return
    elif gap < _NEAR * width and np.hypot(*disk) > 1.0 - _NEAR:
        _say(
            f"{_words(name)} at u = {place:.4g}: edge of a held face or patch, a stress singularity that grows "
            "without bound under refinement"
        )
        return
    wrong = balance.share(state, rod, place, disk) if isinstance(state, State) else 0.0
    if wrong > LARGE:
        _say(
            f"{_words(name)} at u = {place:.4g}: stress residual {100.0 * wrong:.2g} %, a lower bound of its error; "
            "compare with more elements"
        )


def _say(text: str) -> None:
    warnings.warn(text, stacklevel=4)


def _words(name: Component) -> str:
    named = {"von_mises": "von Mises stress", "along": "stress along the rod", "shear": "shear stress in the section"}
    return named.get(name, f"stress {name}".replace("_", " "))


def _values(state: Any, rod: int, name: Component, u: Array, xi: Array) -> Array:
    """Return a component of the stress, shape ``(t, q)``."""
    normals = _normals(state, rod, u, xi) if name in ("along", "shear") else np.empty(0)
    return component(state.stress(rod, u, xi), name, normals)


def _normals(state: Any, rod: int, u: Array, xi: Array) -> Array:
    """Return normals of the sections in their present places, shape ``(t, q, 3)``."""
    _, jacobian = state.model.bodies[rod].space.rod.grid(xi, u)
    moved = state.deformation_gradient(rod, u, xi) @ jacobian
    return np.asarray(np.cross(moved[..., 0], moved[..., 1]))


def _largest(
    state: Any, rod: int, name: Component, u: float | None, xi: tuple[float, float] | None, away: float
) -> Largest:
    """Return the largest stress so far from all that holds a rod: of components that have two signs in size."""

    def size(u: Array, xi: Array) -> Array:
        found = _values(state, rod, name, u, xi)
        if name == "min_principal":
            return -found
        return found if name in ("von_mises", "max_principal", "shear") else np.abs(found)

    space = state.model.bodies[rod].space
    if away == 0.0:
        return largest(space, size, u, xi)

    def counted(u: Array, xi: Array) -> Array:
        far = held.distance(state.model, rod, u) >= away * (1.0 - 1e-9)
        found = np.full((u.size, len(xi)), -np.inf)
        if far.any():
            found[far] = size(u[far], xi)
        return found

    return largest(space, counted, u, xi, held.edges(state.model, rod, away))
