"""The points of a sweep, solved one after the other, near those before where that is known to lead to the same."""

import shlex
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from isorod import options
from isorod.command import chosen, grid, run, sheet
from isorod.command.parser import Parser
from isorod.command.warm import Warm
from isorod.errors import InputError, SolveError
from isorod.output import results
from isorod.petsc.library import unused_options

# What is begun near points before is checked from rest: the first time, each of so many times, and at the last point.
CHECKED = 16

# Options of PETSc's by which Newton's iterations end elsewhere than they do by themselves.
ENDS = ("snes_rtol", "snes_atol", "snes_stol", "snes_max_it", "snes_type", "snes_convergence_test", "snes_ksp_ew")

# How exact estimates of errors are, relative to them.
_ESTIMATE = 1e-5

More = Callable[[Parser, Any], None]


class Points:
    """What a sweep solves.

    Parameters
    ----------
    points
        The grid.
    theirs
        PETSc's words.
    more
        Adds the options of the command (`isorod.command.chosen.choose`).
    cold
        Begin each point from rest.

    Attributes
    ----------
    doubt
        Why points that are there may be of another equilibrium than the one reached from rest; empty where nothing
        says so.
    """

    def __init__(self, points: grid.Grid, theirs: Sequence[str], more: More, cold: bool) -> None:
        self.grid, self.indices, self.doubt = points, points.indices(), ""
        self._theirs, self._more = theirs, more
        self._warm = None if cold or _ends_elsewhere({}) else Warm([one.values for one in points.swept])
        # Points begun near others, and how many of these since the last that was checked.
        self._near = self._unchecked = 0
        self._solved = False

    def solve(self, number: int) -> dict[str, Any]:
        """Solve a point; return its record, which says of one that cannot be solved why.

        Raises
        ------
        InputError
            If nothing has used one of PETSc's options.
        """
        index = self.indices[number]
        told: dict[str, Any] = {"point": number, "values": self.grid.values(index)}
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            try:
                with options.petsc_errors():
                    scene, found, _ = chosen.choose("sweep", self.grid.at(index), self._theirs, self._more)
                    estimated = scene.analysis != "dynamics" and not found.no_estimate
                    told |= {"units": dict(scene.units), "estimated": estimated}
                    record = self._record(index, scene, chosen.settings(scene, found), told)
            except (InputError, SolveError) as problem:
                kind = "refused" if isinstance(problem, InputError) else "failed"
                told |= {"status": f"{kind}: {' '.join(str(problem).split())}"}
                record = {**results.provenance(), "petsc_options": " ".join(self._theirs), "sweep": told}
        told["warnings"] = list(dict.fromkeys(" ".join(str(one.message).split()) for one in said))
        if not self._solved and told["status"] == sheet.SOLVED:
            self._solved = True
            left = unused_options()
            if left:
                raise InputError(f"PETSc option {', '.join(left)}: nothing used it; check its spelling with -help")
        return record

    def _record(
        self, index: tuple[int, ...], scene: Any, settings: dict[str, Any], told: dict[str, Any]
    ) -> dict[str, Any]:
        """Return the record of a point, begun near others or from rest; add to what is told of it."""
        begun: list[bool] = []

        def begin(model: Any) -> Any:
            near = self._warm.near(index, model) if self._warm and not _ends_elsewhere(settings) else None
            begun.append(near is not None)
            return near

        def solved(begin: Callable[[Any], Any] | None) -> tuple[Any, dict[str, Any]]:
            solution, seconds = run.solve(scene, settings, begin)
            return solution, run.record(scene, solution, seconds, settings, self._theirs) | {"sweep": told}

        def estimated(solution: Any) -> dict[str, Any]:
            return run.estimate(solution, bool(getattr(scene, "stresses", ()))) if told["estimated"] else {}

        statics = scene.analysis == "statics" and self._warm is not None
        told["status"] = sheet.SOLVED
        try:
            solution, record = solved(begin if statics else None)
        except (InputError, SolveError):
            if True not in begun:
                raise
            # A run by itself may well find what is not to be had from there.
            begun.clear()
            solution, record = solved(None)
        told["start"] = "near" if True in begun else "rest"
        if told["start"] == "near":
            self._near, self._unchecked = self._near + 1, self._unchecked + 1
            check = self._near % CHECKED == 1 or index == self.indices[-1]
            near = record
            if not check:
                record |= estimated(solution)
            if self.together(check or not _is_clear(record)):
                solution, record = solved(None)
                told["start"] = "rest, as a check"
                self._compare(near, record)
        if "error_estimate" not in record:
            record |= estimated(solution)
        if statics and self._warm is not None:
            self._warm.keep(index, solution)
        return record

    def _compare(self, near: Mapping[str, Any], rest: Mapping[str, Any]) -> None:
        """Begin all points from rest where beginning near others has led elsewhere, and say which are in doubt."""
        if self.together(_alike(near, rest)):
            self._unchecked = 0
            return
        self._warm = None
        # The last one is as it is from rest.
        if self._unchecked > 1:
            at = ", ".join(f"{name} {value}" for name, value in rest["sweep"]["values"].items())
            self.doubt = (
                f"at {at} the equilibrium found from rest is another one than that found near the points before, of "
                f"which {self._unchecked - 1} may be wrong; --cold --overwrite begins each from rest"
            )

    @staticmethod
    def together(decided: Any) -> Any:
        """Return what the first rank has decided."""
        from petsc4py import PETSc

        return PETSc.COMM_WORLD.tompi4py().bcast(decided)


def command(words: Sequence[str], valued: Sequence[str], plain: Sequence[str]) -> str:
    """Return words of a sweep as typed, without the options that change nothing of its numbers.

    These are ``valued``, behind which comes a value, and ``plain``.
    """
    kept, skip = [], False
    for word in words:
        if skip or word in plain or word.partition("=")[0] in valued:
            skip = not skip and word in valued
            continue
        kept.append(word)
    return shlex.join(["isorod", "sweep", *kept])


def _ends_elsewhere(settings: Mapping[str, Any]) -> bool:
    """Return whether Newton's iterations are told to end elsewhere than by themselves."""
    from petsc4py import PETSc

    typed = PETSc.Options()
    return any(typed.hasName(name) or name in (settings.get("petsc") or {}) for name in ENDS)


def _is_clear(record: Mapping[str, Any]) -> bool:
    """Return whether all numbers stand in a table as they would if they were exact."""
    error = record.get("error_estimate")
    around = [sheet.error(error * share) for share in (1.0 - _ESTIMATE, 1.0 + _ESTIMATE)] if error is not None else [""]
    return len({*around}) == 1 and all(map(sheet.are_clear, sheet.answers(record).values()))


def _alike(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether numbers are the same as far as they are exact."""
    pairs = zip(sheet.answers(one).values(), sheet.answers(other).values(), strict=True)
    return all(bool(np.all(np.abs(np.subtract(a, b)) <= sheet.EXACT * np.max(np.abs(b)))) for a, b in pairs)
