"""How far a run is from finite elements: from their limit in what is measured, from the finest mesh in fields."""

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
    model
        The scene's model, whose supports are where stresses have no limit.
    reference
        What finite elements converge to.
    finest
        Fields on their finest mesh.
    names
        What the scene measures.
    """

    model: Any
    reference: Sequence[Converged]
    finest: Sample
    names: Sequence[str]

    @property
    def places(self) -> Places:
        """The points at which fields are compared."""
        return self.finest.places

    def of_mesh(self, record: Record, sample: Sample) -> dict[str, Any]:
        """Return errors of a finite element run; its field is compared at the nodes that the finest mesh has too."""
        here, there = sampled.shared(sample.places, self.places)
        field: dict[str, Any] = {}
        if here.size >= ENOUGH * len(sample.weights):
            own, best = (one.fields(rows) for one, rows in ((sample, here), (self.finest, there)))
            field = self._fields(record, own, best, sample.weights[here])
        if sample.von_mises is not None:
            field |= self._peaks(sample.places, sample.von_mises)
        return self._errors(record, field)

    def of_ours(self, record: Record, arrays: Mapping[str, Array]) -> dict[str, Any]:
        """Return errors of a run of isorod; ``arrays`` are its fields at the `places`."""
        everywhere = slice(None)
        field = self._fields(record, arrays, self.finest.fields(everywhere), self.finest.weights)
        if self.finest.von_mises is not None:
            field |= self._peaks(self.places, arrays["von_mises"]) | self._stress(arrays["von_mises"])
        return self._errors(record, field)

    def _fields(
        self, record: Record, own: Mapping[str, Array], best: Mapping[str, Array], weights: Array
    ) -> dict[str, Any]:
        if "displacement" in best:
            return {"displacement": sampled.relative(own["displacement"], best["displacement"], weights)}
        frequencies = np.array(quantities.values(record, [FREQUENCIES])[FREQUENCIES])
        wanted = self.finest.frequencies
        assert wanted is not None
        partner, left = sampled.pairs(own["modes"], best["modes"], weights, (frequencies, wanted))
        # The last may be one of a pair, of which the other was not asked for.
        whole = left[wanted < (1.0 - sampled.CLOSE) * wanted[-1]]
        return {"partner": partner.tolist(), "shapes": left.tolist(), "shape": float(max(whole, default=0.0))}

    def _peaks(self, places: Places, von_mises: Array) -> dict[str, float]:
        """Return the largest stress away from held places, and how far it is from that of the finest mesh."""
        best = self.finest
        assert best.von_mises is not None
        found = []
        for where, values in ((places, von_mises), (best.places, best.von_mises)):
            inside = sampled.away(self.model, where.stress_rod, where.stress_u)
            if not inside.any():
                return {}
            found.append(float(values[inside].max()))
        return {"peak": found[0], "peak_error": abs(found[0] / found[1] - 1.0)}

    def _stress(self, von_mises: Array) -> dict[str, float]:
        """Return how far stresses are from those of the finest mesh, away from held places."""
        best = self.finest
        assert best.von_mises is not None
        inside = sampled.away(self.model, best.places.stress_rod, best.places.stress_u)
        if not inside.any():
            return {}
        wanted = best.von_mises[inside]
        return {"von_mises": sampled.relative(von_mises[inside], wanted, best.stress_weights[inside])}

    def _errors(self, record: Record, field: dict[str, Any]) -> dict[str, Any]:
        found = quantities.values(record, self.names)
        if "partner" in field:
            found[FREQUENCIES] = [found[FREQUENCIES][k] for k in field["partner"]]
        errors = quantities.errors(self.reference, found)
        error = max(errors.values(), default=0.0)
        if all(one.given for one in self.reference if one.name in errors):
            # Nothing measured tells of the discretisation.
            error = max(error, field.get("displacement", 0.0))
        return {"values": found, "errors": errors, "error": error, "field": field}
