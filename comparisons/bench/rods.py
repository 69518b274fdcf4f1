"""Spring and blade: error against run time of every program, on meshes of the very same geometry."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import ClassVar

from comparisons import blade, spring
from comparisons.fem.presets import blade as fem_blade
from comparisons.fem.presets import spring as fem_spring
from comparisons.fem.presets.family import Family
from comparisons.measure import timing
from comparisons.measure.convergence import extrapolate, richardson
from comparisons.measure.records import Record
from comparisons.measure.study import Run, Steps
from comparisons.measure.work import AS_RUN, Curve, WorkPrecision, fem_curves, named, steps_of, with_others
from comparisons.ngsolve import presets as ngsolve


class Scene:
    """A scene with its curves.

    Parameters
    ----------
    level
        Of the study.
    here
        Programs beside dolfinx (keys of `comparisons.measure.work.MODULES`).
    others
        Interpreters whose dolfinx is measured too.
    kept
        Runs of the same rods, which scenes share that measure something else of them.
    """

    name: ClassVar[str]
    file: ClassVar[str] = ""
    targets: ClassVar[Mapping[str, Sequence[float]]]
    families: ClassVar[Mapping[str, Mapping[str, Sequence[Family]]]]
    best: ClassVar[Mapping[str, Mapping[float, Sequence[str]]]]
    finer: ClassVar[Mapping[str, Sequence[tuple[str, int]]]]
    ours: ClassVar[Mapping[str, Sequence[Curve]]]
    reference: ClassVar[Mapping[str, Family]]

    def __init__(
        self, level: str, here: Sequence[str], others: Sequence[str], kept: dict[tuple[str, ...], Record]
    ) -> None:
        self.level, self.here, self.others, self.kept = level, here, others, kept

    @cached_property
    def curves(self) -> tuple[Curve, ...]:
        """The curves of all programs."""
        own = [curve for curve in self.ours[self.level] if curve.method == "cylindrical"]
        fem = fem_curves(self.families["fem"][self.level])
        more = [one for name in self.here for one in fem_curves(self.families[name][self.level], name)]
        return (*self._whole("cylindrical", own), AS_RUN, *with_others(self._whole("fem", fem), self.others), *more)

    def _whole(self, method: str, curves: Sequence[Curve]) -> list[Curve]:
        """Return the curves of a side, and one of what else is known to be fastest: every level measures that."""
        there = {one for curve in curves for one in curve.arguments}
        known = dict.fromkeys(one for target in self.targets[self.level] for one in self.best[method][target])
        missing = tuple(one for one in known if one not in there)
        return [*curves, *([Curve("known to be fast", method, missing)] if missing else [])]

    @property
    def steps(self) -> int:
        """Number of steps that `run` shows."""
        return self.meshes + steps_of(self.curves, self.targets[self.level])

    @property
    def meshes(self) -> int:
        """Number of runs that tell the converged values."""
        return len(self.reference[self.level].meshes)

    def run(self, study: Run, steps: Steps) -> None:
        """Record converged values and the work of every program."""
        limits = self.converged(study, steps)
        finer = {name: self.finer["fem"] for name in self.here} | dict(self.finer)
        work = WorkPrecision(
            study, steps, self.name, finer, lambda found: self.error(found, limits), self.file, self.kept
        )
        targets = self.targets[self.level]
        work.run(
            self.curves,
            targets,
            {
                target: [*AS_RUN.arguments, *(one for side in self.best.values() for one in side[target])]
                for target in targets
            },
        )

    def converged(self, study: Run, steps: Steps) -> Mapping[str, Sequence[float]]:
        """Record what finite elements converge to, by name, and return it."""
        raise NotImplementedError

    def error(self, found: Record, limits: Mapping[str, Sequence[float]]) -> float:
        """Return the error of a run against the limits."""
        raise NotImplementedError

    def _family(self, study: Run, steps: Steps) -> tuple[list[float], list[Record]]:
        """Return sizes and records of the meshes that are extrapolated."""
        records = []
        for arguments in self.reference[self.level].arguments:
            with steps.step(f"{self.name}, converged value: {arguments}"):
                words = (*named("fem", self.name, self.file), *arguments.split())
                if words not in self.kept:
                    self.kept[words] = timing.run("comparisons.fem", words)
                records.append(study.record("convergence", self.kept[words]))
        return [1.0 / record["options"]["layers"] for record in records], records


class Spring(Scene):
    """The pulled spring: the force."""

    name = "spring"
    targets: ClassVar[Mapping[str, Sequence[float]]] = {"quick": (1e-2, 1e-3), "full": (1e-2, 1e-3, 1e-4)}
    families: ClassVar[Mapping[str, Mapping[str, Sequence[Family]]]] = {
        # Of those of the study, the ones that come first somewhere.
        "fem": {
            "quick": [one for one in fem_spring.QUICK if one.label not in ("Q2 bricks", "P2 tetrahedra")],
            "full": fem_spring.FULL,
        },
        "ngsolve": ngsolve.SPRING,
    }
    best: ClassVar[Mapping[str, Mapping[float, Sequence[str]]]] = {"cylindrical": spring.BEST, "fem": fem_spring.BEST}
    finer = spring.FINER
    ours = spring.CURVES
    reference: ClassVar[Mapping[str, Family]] = fem_spring.CONVERGED

    def converged(self, study: Run, steps: Steps) -> Mapping[str, Sequence[float]]:
        """Record the extrapolated force and return it."""
        sizes, records = self._family(study, steps)
        limit = richardson(sizes, [record["force"] for record in records])
        values = {"force": limit.value, "order": limit.order, "uncertainty": limit.distance}
        study.record("converged", {"scene": self.name} | values)
        return {"force": [limit.value]}

    def error(self, found: Record, limits: Mapping[str, Sequence[float]]) -> float:
        """Return the relative error of the force."""
        return abs(float(found["force"]) / limits["force"][0] - 1.0)


class Blade(Scene):
    """The blade's ten lowest frequencies."""

    name = "blade"
    targets: ClassVar[Mapping[str, Sequence[float]]] = {"quick": (5e-3, 5e-4), "full": (1e-2, 5e-3, 1e-3, 5e-4)}
    families: ClassVar[Mapping[str, Mapping[str, Sequence[Family]]]] = {
        "fem": {
            "quick": [one for one in fem_blade.QUICK if one.label != "P2 tetrahedra"],
            "full": fem_blade.FULL,
        },
        "ngsolve": ngsolve.BLADE,
    }
    best: ClassVar[Mapping[str, Mapping[float, Sequence[str]]]] = {"cylindrical": blade.BEST, "fem": fem_blade.BEST}
    finer = blade.FINER
    ours = blade.CURVES
    # An error of 0.05 % takes the full level's.
    reference: ClassVar[Mapping[str, Family]] = {level: fem_blade.CONVERGED["full"] for level in ("quick", "full")}

    def converged(self, study: Run, steps: Steps) -> Mapping[str, Sequence[float]]:
        """Record the extrapolated frequencies and return them."""
        sizes, records = self._family(study, steps)
        found = [extrapolate(sizes, one) for one in zip(*(record["frequencies"] for record in records), strict=True)]
        values = [limit.value for limit in found]
        told = max(limit.distance / limit.value for limit in found)
        study.record("converged", {"scene": self.name, "frequencies": values, "uncertainty": told})
        return {"frequencies": values}

    def error(self, found: Record, limits: Mapping[str, Sequence[float]]) -> float:
        """Return the largest relative error of the frequencies."""
        return blade.largest_error(found["frequencies"], limits["frequencies"])
