"""How far a run is from finite elements: from their limit in measured quantities, from the finest mesh in fields."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from comparisons.measure import quantities, sampled
from comparisons.measure.quantities import FREQUENCIES, Converged
from comparisons.measure.records import Record
from comparisons.measure.sampled import Places, Sample
from isorod.arrays import Array

# Share of a mesh's nodes that the finest must have too for fields to be compared; of level 2 that of level 3 has one in
# eight.
ENOUGH = 0.05


@dataclass(frozen=True)
class Judge:
    """Tells the errors of runs.

    Parameters
    ----------
    reference
        What finite elements converge to.
    finest
        Fields on their finest mesh.
    names
        What the scene measures.
    stresses
        Those of them that are stresses, which have an error of their own.
    """

    reference: Sequence[Converged]
    finest: Sample
    names: Sequence[str]
    stresses: Sequence[str] = ()

    @property
    def places(self) -> Places:
        """The points at which fields are compared."""
        return self.finest.places

    def of_mesh(self, record: Record, sample: Sample) -> dict[str, Any]:
        """Return errors of a finite element run; its field is compared at the finest mesh's nodes."""
        field: dict[str, Any] = {}
        if sample.reference is not None:
            best = self.finest.fields(slice(None))
            field = self._fields(record, sample.on(self.finest.points), best, self.finest.weights)
            return self._errors(record, field | self._surface(sample.surface_von_mises))
        here, there = sampled.common(sample.places, self.places)
        if here.size >= ENOUGH * len(sample.weights):
            own, best = (one.fields(rows) for one, rows in ((sample, here), (self.finest, there)))
            field = self._fields(record, own, best, sample.weights[here])
        field |= self._surface(sample.surface_von_mises)
        return self._errors(record, field)

    def of_ours(self, record: Record, arrays: Mapping[str, Array]) -> dict[str, Any]:
        """Return errors of a run of isorod; ``arrays`` are its fields at the `places`."""
        everywhere = slice(None)
        field = self._fields(record, arrays, self.finest.fields(everywhere), self.finest.weights)
        field |= self._surface(arrays.get("von_mises"))
        return self._errors(record, field)

    def _fields(
        self, record: Record, own: Mapping[str, Array], best: Mapping[str, Array], weights: Array
    ) -> dict[str, Any]:
        if "displacement" in best:
            return {"displacement": sampled.relative(own["displacement"], best["displacement"], weights)}
        frequencies = np.array(quantities.values(record, [FREQUENCIES])[FREQUENCIES])
        references = self.finest.frequencies
        assert references is not None
        partner, left = sampled.pairs(own["modes"], best["modes"], weights, (frequencies, references))
        # The last may be one of a pair, of which the other was not asked for.
        low = left[references < (1.0 - sampled.CLOSE) * references[-1]]
        return {"partner": partner.tolist(), "shapes": left.tolist(), "shape": float(max(low, default=0.0))}

    def between(self, record: Record, own: Array | None, other: Record, better: Array | None) -> float:
        """Return how far stresses of a run of isorod are from a better one's: measured ones, or those at surfaces."""
        known = [name for name in self.stresses if name in record["errors"]]
        if known:
            return max(_relative(record["values"][name], other["values"][name]) for name in known)
        assert own is not None and better is not None
        return apart(own, better)

    def _surface(self, von_mises: Array | None) -> dict[str, float]:
        """Return the largest stress at surfaces, and how far stresses there are from those of the finest mesh."""
        best = self.finest.surface_von_mises
        if von_mises is None or best is None or not best.size:
            return {}
        return {"peak": float(von_mises.max()), "stress": apart(von_mises, best)}

    def _errors(self, record: Record, field: dict[str, Any]) -> dict[str, Any]:
        values = quantities.values(record, self.names)
        if "partner" in field:
            values[FREQUENCIES] = [values[FREQUENCIES][k] for k in field["partner"]]
        errors = quantities.errors(self.reference, values)
        stresses = [error for name, error in errors.items() if name in self.stresses]
        error = max((one for name, one in errors.items() if name not in self.stresses), default=0.0)
        if all(one.given for one in self.reference if one.name in {*errors} - {*self.stresses}):
            # No measured quantity depends on the discretisation.
            error = max(error, field.get("displacement", 0.0))
        own = {"values": values, "errors": errors, "error": error, "field": field}
        stress = max(stresses, default=field.get("stress"))
        return own if stress is None else own | {"stress": stress}


def apart(values: Array, reference: Array) -> float:
    """Return the largest difference of von Mises stresses ``(m,)``, relative to the largest reference."""
    return float(np.abs(values - reference).max() / reference.max()) if reference.max() > 0.0 else 0.0


def _relative(values: Sequence[float], reference: Sequence[float]) -> float:
    size = float(np.linalg.norm(reference))
    return float(np.linalg.norm(np.subtract(values, reference))) / size if size else 0.0
