"""What a scene file can ask of laws with memory."""

from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.output.largest import Largest, largest, peak
from isorod.output.words import StateComponent

if TYPE_CHECKING:
    from isorod.statics.analysis import Equilibrium


def state(
    solution: "Equilibrium",
    rod: int,
    name: str,
    component: StateComponent | None = None,
    u: float | None = None,
    xi: tuple[float, float] | None = None,
    branch: int | None = None,
) -> Any:
    """Return what a law with memory knows at a point of a rod (statics alone); without a place the largest.

    Parameters
    ----------
    rod
        Whose state it is.
    name
        ``"p"``, accumulated plastic strain, ``"plastic_strain"`` or ``"viscous_strain"``; ``"dissipated"``, energy per
        volume.
    component
        Of strains ``"equivalent"``, ``sqrt(2/3 e:e)``, where not given, or a component in space at rest, ``"xx"`` ...
        ``"yz"``.
    u
        Axis parameter of the point; where not given the largest along the rod, in size.
    xi
        Its point of the unit disk, ``[1, 0]`` on the surface; where not given the largest of the section.
    branch
        Of several viscous strains which, from 1 on.
    """
    # Loads compiled functions.
    from isorod.output.stress import of_six

    def values(u: Array, xi: Array) -> Array:
        components = solution.state(name, rod, u, xi)
        strains = components.shape[-1] // 6
        for key, given in (("component", component), ("branch", branch)):
            if given is not None and not strains:
                raise InputError(f"{key}: {name!r} is one number; leave it out")
        if not strains:
            return components[..., 0]
        first = 1 if branch is None else branch
        if not 1 <= first <= strains:
            raise InputError(f"branch: got {first}, need 1 to {strains}")
        return of_six(components[..., 6 * first - 6 : 6 * first], component or "equivalent")

    def size(u: Array, xi: Array) -> Array:
        # Where another law has no such number it is none.
        return np.nan_to_num(np.abs(values(u, xi)))

    if xi is not None and np.hypot(*xi) > 1.0 + 1e-9:
        raise InputError(f"xi: got {list(xi)}, need a point of the unit disk")
    if u is not None and xi is not None:
        places = [Largest(0.0, u, np.array(xi))]
    else:
        places = largest(solution.model.bodies[rod].space, size, u, xi)
    extreme = peak(places, lambda u, xi: float(values(np.array([u]), xi[None])[0, 0]))
    if np.isnan(extreme.value):
        raise InputError(f"name: the law at u = {places[0].u:g}, xi = {places[0].xi.tolist()} has no {name!r}")
    return extreme.value if u is not None and xi is not None else extreme


def dissipated(solution: "Equilibrium", rod: int) -> float:
    """Return what the laws of a rod have dissipated since rest, force times length (statics alone).

    Parameters
    ----------
    rod
        Which one.
    """
    return solution.dissipated(rod)
