"""Error against run time: curves of discretisations, and the fastest that reaches an error and keeps it."""

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from comparisons.measure import timing
from comparisons.measure.records import Record
from comparisons.measure.rod import WHOLE, find
from comparisons.measure.study import Run, Steps
from comparisons.measure.variants import written
from isorod.errors import SolveError

# Runs of each configuration, the first one cold: the median is of five.
REPEAT = 6

# How often the fastest of both sides are measured again, in turn; the least of the medians counts.
TURNS = 3

MODULES = {
    "cylindrical": "comparisons.measure.rod",
    "fem": "comparisons.fem",
    "ngsolve": "comparisons.ngsolve",
}


@dataclass(frozen=True)
class Curve:
    """A family of discretisations, coarse to fine, that makes one curve of the work-precision diagram.

    ``interpreter`` is the Python that measures it.
    """

    label: str
    method: str
    arguments: tuple[str, ...]
    interpreter: str = sys.executable


# With nothing chosen by hand, the estimate of the error within the time.
AS_RUN = Curve("as isorod run has it", "cylindrical", (WHOLE,))


class Family(Protocol):
    """A finite element and its meshes, coarse to fine."""

    @property
    def label(self) -> str:
        """Name of the curve."""

    @property
    def arguments(self) -> tuple[str, ...]:
        """Arguments of each run."""


def fem_curves(families: Sequence[Family], method: str = "fem") -> tuple[Curve, ...]:
    """Return the curves of families of finite element meshes, measured by a program (a key of `MODULES`)."""
    return tuple(Curve(family.label, method, tuple(family.arguments)) for family in families)


def with_others(curves: Sequence[Curve], interpreters: Sequence[str]) -> tuple[Curve, ...]:
    """Return the curves, with finite elements' repeated for each other interpreter and its dolfinx."""
    fem = [curve for curve in curves if curve.method == "fem"]
    return (*curves, *(replace(curve, interpreter=one) for one in interpreters for curve in fem))


def _sides(curves: Sequence[Curve]) -> list[tuple[str, str]]:
    """Return whom the fastest runs are of: methods, each with its interpreter."""
    return list(dict.fromkeys((curve.method, curve.interpreter) for curve in curves))


@dataclass(frozen=True)
class WorkPrecision:
    """Measures a scene along curves.

    Parameters
    ----------
    study, steps
        Where records go, and what shows the progress.
    scene
        Name of the scene.
    finer
        One step finer along the axis, and one in the section, by method: option and what is added to it.  Options that
        a run does not have are passed over.
    error
        Error of a record.
    file
        The scene's file, where it is none of the package.
    kept
        Runs by program, interpreter, arguments and repetitions: scenes with other quantities of the same rods share
        them.  What is measured side by side is measured anew.
    """

    study: Run
    steps: Steps
    scene: str
    finer: Mapping[str, Sequence[tuple[str, int]]]
    error: Callable[[Record], float]
    file: str = ""
    kept: dict[tuple[str, ...], Record] = field(default_factory=dict)

    def _measure(self, side: tuple[str, str], arguments: str, repeat: int, again: bool = False) -> Record:
        method, interpreter = side
        key = (method, interpreter, arguments, str(repeat))
        if again or key not in self.kept:
            words = [*named(method, self.scene, self.file), *arguments.split(), "--repeat", str(repeat)]
            self.kept[key] = timing.run(MODULES[method], words, interpreter=interpreter)
        record = self.kept[key]
        measured = {"scene": self.scene, "arguments": arguments, "error": self.error(record)}
        return record | measured | {"interpreter": interpreter}

    def run(self, curves: Sequence[Curve], targets: Sequence[float], known: Mapping[float, Sequence[str]]) -> None:
        """Record error and warm run time along each curve, or the refusal, then the fastest runs within each target.

        ``known`` are arguments that were the fastest within a target before.  They are measured again with the fastest
        of today: a machine that is busy for a moment must not keep them from winning.
        """
        work = []
        for curve in curves:
            for arguments in curve.arguments:
                with self.steps.step(f"{curve.label}: {arguments}"):
                    try:
                        record = self._measure((curve.method, curve.interpreter), arguments, REPEAT)
                    except SolveError as problem:
                        refused = {
                            "scene": self.scene,
                            "curve": curve.label,
                            "arguments": arguments,
                            "message": str(problem),
                        }
                        self.study.record("refused", refused)
                        continue
                    work.append(self.study.record("work", record | {"curve": curve.label}))
        for target in targets:
            fastest = []
            for side in _sides(curves):
                mine = [one for one in work if _side(one) == side]
                with self.steps.step(f"fastest {side[0]} within {100 * target:g} %"):
                    fastest += self._confirm(mine, target, known[target])
            with self.steps.step(f"side by side within {100 * target:g} %"):
                self._side_by_side(fastest)

    def _side_by_side(self, fastest: Sequence[Record]) -> None:
        """Measure runs again, in turn, and record them with the least of the median times.

        The machine may have been busy before.
        """
        again: list[list[dict[str, float]]] = [[] for _ in fastest]
        for _ in range(TURNS):
            for record, seconds in zip(fastest, again, strict=True):
                seconds.append(self._measure(_side(record), record["arguments"], REPEAT, again=True)["seconds"])
        for record, seconds in zip(fastest, again, strict=True):
            totals = [one["total"] for one in seconds]
            best = seconds[totals.index(min(totals))]
            self.study.record("confirm", record | {"seconds": best, "turns": totals})

    def _confirm(self, work: Sequence[Record], target: float, known: Sequence[str]) -> list[Record]:
        """Return the fastest run within the target that stays within it when axis or section alone is refined.

        Beside it, those whose arguments are known to have been the fastest and that stay within it too.

        On a coarse mesh errors of the axis and of the section can cancel; what is within the target by that luck is
        recorded, as not holding.
        """
        held: list[Record] = []
        for record in sorted(work, key=lambda record: record["seconds"]["total"]):
            if record["error"] > target or (held and record["arguments"] not in known):
                continue
            finer: list[Record] = []
            given = record["arguments"]
            if given in AS_RUN.arguments:
                given = written(find(self.file or self.scene, {}), record["discretisation"])
            for option, step in self.finer[record["method"]]:
                count = re.search(rf"{option} (\d+)", given)
                if count is None:
                    continue
                arguments = given.replace(count[0], f"{option} {int(count[1]) + step}")
                try:
                    near = self._measure(_side(record), arguments, 1)
                except SolveError:
                    finer = []
                    break
                finer.append({"arguments": arguments, "error": near["error"]})
                if near["error"] > target:
                    break
            holds = len(finer) > 1 and all(near["error"] <= target for near in finer)
            confirmed = record | {"target": target, "finer": finer, "holds": holds}
            if holds:
                held.append(confirmed)
            else:
                self.study.record("confirm", confirmed)
        return held


def named(method: str, scene: str, file: str = "") -> list[str]:
    """Return the words that name a scene to a program: its name, or its file."""
    if not file:
        return [scene]
    return ["rods", file] if method == "fem" else [file]


def _side(record: Record) -> tuple[str, str]:
    return record["method"], record["interpreter"]


def steps_of(curves: Sequence[Curve], targets: Sequence[float]) -> int:
    """Return the number of steps that `WorkPrecision.run` shows."""
    return sum(len(curve.arguments) for curve in curves) + len(targets) * (len(_sides(curves)) + 1)
