"""Stress at a place, or the largest and where it is."""

import warnings
from typing import Any, NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.checks import stresses
from isorod.errors import InputError
from isorod.output import balance, held
from isorod.output.largest import Largest, Peak, largest, peak
from isorod.output.state import State
from isorod.output.stress import component
from isorod.output.words import Component

# A stress is that of an edge if farther from it, by the width of the section, it is so much smaller; and, at a point
# that was asked for, if the point is so near, in parts of that width, to a held face.
_LARGER, _NEAR = 1.01, 0.05

# Part of that width from which on a length `away` that is given keeps off edges.
_FAR = 0.1

# Components below this fraction of the von Mises stress give no warning.
_NOTHING = 1e-3

# Share of the stress from which what is out of balance is warned of.
LARGE = 0.03


class Sought(NamedTuple):
    """The stress that `isorod.files.measures.stress` asks for, by its parameters."""

    rod: int
    name: Component
    u: float | None
    xi: tuple[float, float] | None
    away: float | None

    def find(self, state: Any) -> float | Peak:
        """Return it, of one state."""
        u, xi, away = self.u, self.xi, self.away
        if away is not None and not away >= 0.0:
            raise InputError(f"away: got {away:g}, need a length, not negative")
        if away is not None and u is not None:
            raise InputError("away: it goes with the largest along a rod, and not with a place u")
        if xi is not None and np.hypot(*xi) > 1.0 + 1e-9:
            raise InputError(f"xi: got {list(xi)}, need a point of the unit disk")
        if u is not None and xi is not None:
            return float(self._at(state, u, np.array(xi)))
        candidates = self._largest(state, u, xi, away or 0.0)
        if not np.isfinite(candidates[0].value):
            raise InputError(f"away: got {away:g}, but no point of the rod is that far from all supports")
        return peak(candidates, lambda u, xi: self._at(state, u, xi))

    def warn(self, state: Any, result: float | Peak) -> None:
        """Warn of a stress that is one of an edge, or out of balance."""
        if isinstance(result, Peak):
            value, u, angle = result.value, result.place["u"], np.radians(result.place["angle"])
            xi = result.place["radius"] * np.array([np.cos(angle), np.sin(angle)])
        else:
            assert self.u is not None and self.xi is not None
            value, u, xi = result, self.u, np.array(self.xi)
        if abs(value) <= _NOTHING * self._replace(name="von_mises")._at(state, u, xi):
            return
        gap, width = held.distance(state.model, self.rod, np.array([u]))[0], held.width(state.model, self.rod)
        # A user who gives a distance knows of the edge, unless the distance is tiny.
        if self.u is None and gap < (_FAR if self.away else 1.0) * width:
            beyond = self._largest(state, None, self.xi, width)[0].value
            if value * (-1.0 if self.name == "min_principal" or value < 0.0 else 1.0) > _LARGER * beyond:
                known = f"; farther off than the section is wide (away = {width:.3g}) it is {beyond:.4g}"
                _warn(
                    f"largest {_words(self.name)} {value:.4g} is {gap:.2g} from the edge of a held face or patch, a "
                    "stress singularity that grows without bound under refinement"
                    + (known if np.isfinite(beyond) else "")
                )
                return
        elif gap < _NEAR * width and np.hypot(*xi) > 1.0 - _NEAR:
            _warn(
                f"{_words(self.name)} at u = {u:.4g}: edge of a held face or patch, a stress singularity that grows "
                "without bound under refinement"
            )
            return
        contacts = [one for one in getattr(state, "contacts", ()) if one.peak]
        near = stresses.to_contact(contacts, state.position(self.rod, u, xi)) if contacts else np.inf
        error = max(((one.peak_error or 0.0) * one.peak / abs(value) for one in contacts), default=0.0)
        if near < stresses.CLEAR * width and error > LARGE:
            _warn(
                f"{_words(self.name)} at u = {u:.4g}: {near:.2g} from contact whose largest pressure is known roughly, "
                f"may be off by {100.0 * min(error, 1.0):.2g} %; compare with shorter elements and more section points"
            )
            return
        wrong = balance.relative_imbalance(state, self.rod, u, xi) if isinstance(state, State) else 0.0
        if wrong > LARGE:
            _warn(
                f"{_words(self.name)} at u = {u:.4g}: stress residual {100.0 * wrong:.2g} %, a lower bound of its "
                "error; compare with more elements"
            )

    def _at(self, state: Any, u: float, xi: Array) -> float:
        """Return the stress at a point."""
        return float(self._values(state, np.array([u]), xi[None])[0, 0])

    def _values(self, state: Any, u: Array, xi: Array) -> Array:
        """Return the stress, shape ``(t, q)``."""
        normals = np.empty(0)
        if self.name in ("along", "shear"):
            # Of the sections in their present places.
            _, jacobian = state.model.bodies[self.rod].space.rod.grid(xi, u)
            moved = state.deformation_gradient(self.rod, u, xi) @ jacobian
            normals = np.cross(moved[..., 0], moved[..., 1])
        tensors = state.stress(self.rod, u, xi)
        if hasattr(state, "amplitude"):
            return np.asarray(state.amplitude(tensors, self.name, normals))
        return component(tensors, self.name, normals)

    def _largest(self, state: Any, u: float | None, xi: tuple[float, float] | None, away: float) -> list[Largest]:
        """Return where the stress is largest so far from all that holds the rod: of two signs in size."""

        def size(u: Array, xi: Array) -> Array:
            values = self._values(state, u, xi)
            if self.name == "min_principal":
                return -values
            return values if self.name in ("von_mises", "max_principal", "shear") else np.abs(values)

        model = state.model
        space = model.bodies[self.rod].space
        if away == 0.0:
            return largest(space, size, u, xi)

        def counted(u: Array, xi: Array) -> Array:
            far = held.distance(model, self.rod, u) >= away * (1.0 - 1e-12)
            masked = np.full((u.size, len(xi)), -np.inf)
            if far.any():
                masked[far] = size(u[far], xi)
            return masked

        return largest(space, counted, u, xi, held.edges(model, self.rod, away))


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=4)


def _words(name: Component) -> str:
    named = {"von_mises": "von Mises stress", "along": "stress along the rod", "shear": "shear stress in the section"}
    return named.get(name, f"stress {name}".replace("_", " "))
