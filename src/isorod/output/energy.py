"""Stored and dissipated energy of a body."""

from collections.abc import Mapping

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.material.along_rod import complementary, shear_laws, volume_change
from isorod.material.memory import has_memory
from isorod.model.body import Body
from isorod.output.stress import known

# Elements evaluated at a time, to limit memory.
_CHUNK = 32


def stored(body: Body, fields: Mapping[str, Array], factor: float) -> float:
    """Return ``int W dV`` by the space's quadrature, with the contribution of active fibres of muscles.

    In the mixed formulation it is the value of its functional, equal at a solution.

    Parameters
    ----------
    fields
        Fields of a state (`isorod.output.state.State.fields`): ``displacement`` and, of a mixed body, ``pressure``.
    factor
        Load factor, which a muscle's activation follows.
    """
    space, total = body.space, 0.0
    if silent := next((law for law in body.laws if has_memory(law) and not law.stores), None):
        raise InputError(f"energy: {type(silent).__name__} does not compute its stored energy")
    for begin in range(0, space.axis.elements, _CHUNK):
        table = space.tabulate(begin, min(begin + _CHUNK, space.axis.elements))
        u = table.u.ravel()
        _, F = space.displacement(fields["displacement"], table.xi, u)
        laws = body.laws_at(u, table.xi).at(factor)
        if body.pressures is None:
            density = laws.energy(F)
        else:
            p = body.pressures.evaluate(fields["pressure"], table.xi, u)
            density = shear_laws(laws).energy(F) + p * volume_change(laws, F)[0] - complementary(laws, p)[0]
        total += float(np.sum(table.weights.reshape(density.shape) * density))
    return total


def dissipated(body: Body, fields: Mapping[str, Array], factor: float) -> float:
    """Return the energy dissipated since rest by laws with memory, by the space's quadrature; 0 without such laws."""
    space, total = body.space, 0.0
    if not body.remembers:
        return total
    dumb = next((law for law in body.laws if law.remembers and "dissipated" not in law.states), None)
    if dumb is not None:
        raise InputError(f"dissipated: {type(dumb).__name__} does not compute its dissipation")
    for begin in range(0, space.axis.elements, _CHUNK):
        table = space.tabulate(begin, min(begin + _CHUNK, space.axis.elements))
        density = known(body, fields["displacement"], table.xi, table.u.ravel(), factor, ["dissipated"])["dissipated"]
        total += float(np.nansum(table.weights.reshape(density.shape[:-1]) * density[..., 0]))
    return total
