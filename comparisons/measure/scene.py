"""A scene that is measured along curves, against the limit of finite elements on three meshes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from comparisons.measure import timing
from comparisons.measure.convergence import limits
from comparisons.measure.records import Record
from comparisons.measure.study import Run, Steps
from comparisons.measure.work import Curve, Family, WorkPrecision, named, steps_of

Limits = Mapping[str, Sequence[float]]


@dataclass(frozen=True)
class Scene:
    """A scene with its curves.

    Parameters
    ----------
    name
        Of the scene.
    measured
        Keys of the measured quantities in records, scalars or lists.
    reference
        Finite elements on nested meshes, coarse to fine, whose results are extrapolated.
    curves
        Of all programs.
    known
        Target errors, each with the arguments that were the fastest within it in earlier runs.
    finer, file
        See `comparisons.measure.work.WorkPrecision`.
    kept
        Runs by their arguments, for scenes that measure other quantities of the same rods.
    """

    name: str
    measured: Sequence[str]
    reference: Family
    curves: Sequence[Curve]
    known: Mapping[float, Sequence[str]]
    finer: Mapping[str, Sequence[tuple[str, int]]]
    file: str = ""
    kept: dict[tuple[str, ...], Record] = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """Number of steps that `run` shows."""
        return len(self.reference.arguments) + steps_of(self.curves, [*self.known])

    def run(self, study: Run, steps: Steps) -> Limits:
        """Record converged values and the work of every program; return the former by name."""
        values = self._converged(study, steps)
        work = WorkPrecision(
            study, steps, self.name, self.finer, lambda record: self.error(record, values), self.file, self.kept
        )
        work.run(self.curves, [*self.known], self.known)
        return values

    def error(self, record: Record, values: Limits) -> float:
        """Return the largest relative error of a run's measured quantities."""
        ratios = [np.ravel(record[name]) / np.array(values[name]) for name in self.measured]
        return max(float(np.abs(ratio - 1.0).max()) for ratio in ratios)

    def _converged(self, study: Run, steps: Steps) -> Limits:
        records = []
        for arguments in self.reference.arguments:
            with steps.step(f"{self.name}, converged value: {self.reference.label} {arguments}"):
                words = (*named("fem", self.name, self.file), *arguments.split())
                if words not in self.kept:
                    self.kept[words] = timing.run("comparisons.fem", words)
                records.append(study.record("convergence", self.kept[words] | {"arguments": arguments}))
        results = limits(records, self.measured)
        values = {name: [limit.value for limit in numbers] for name, numbers in results.items()}
        orders = {name: [limit.order for limit in numbers] for name, numbers in results.items()}
        uncertainty = max(abs(limit.distance / limit.value) for numbers in results.values() for limit in numbers)
        head = {"scene": self.name, "element": self.reference.label, "orders": orders, "uncertainty": uncertainty}
        study.record("converged", head | values)
        return values
