"""A scene that is measured along curves, against what finite elements on three meshes converge to."""

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
        Keys of records: what is measured, a number or several.
    reference
        Finite elements on meshes coarse to fine, whose results are extrapolated.
    curves
        Of all programs.
    known
        By the errors at which run times are compared, arguments that were the fastest within them before.
    finer, file
        See `comparisons.measure.work.WorkPrecision`.
    kept
        Runs of the same rods, which scenes share that measure something else of them.
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
            study, steps, self.name, self.finer, lambda found: self.error(found, values), self.file, self.kept
        )
        work.run(self.curves, [*self.known], self.known)
        return values

    def error(self, found: Record, values: Limits) -> float:
        """Return the largest relative error of what a run measured."""
        return max(
            float(np.max(np.abs(np.ravel(found[name]) / np.array(values[name]) - 1.0))) for name in self.measured
        )

    def _converged(self, study: Run, steps: Steps) -> Limits:
        records = []
        for arguments in self.reference.arguments:
            with steps.step(f"{self.name}, converged value: {self.reference.label} {arguments}"):
                words = (*named("fem", self.name, self.file), *arguments.split())
                if words not in self.kept:
                    self.kept[words] = timing.run("comparisons.fem", words)
                records.append(study.record("convergence", self.kept[words] | {"arguments": arguments}))
        found = limits(records, self.measured)
        values = {name: [one.value for one in every] for name, every in found.items()}
        told = max(abs(one.distance / one.value) for every in found.values() for one in every)
        orders = {name: [one.order for one in every] for name, every in found.items()}
        known = {"scene": self.name, "element": self.reference.label, "orders": orders, "uncertainty": told}
        study.record("converged", known | values)
        return values
