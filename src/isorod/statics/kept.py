"""What statics keeps in a checkpoint: where the load steps are, from which they go on to the last bit."""

import hashlib
from pathlib import Path as File
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod import __version__
from isorod.arrays import Array
from isorod.assembly.factorisation import is_mixed
from isorod.checks.reactions import Carried
from isorod.errors import InputError
from isorod.model.model import Model
from isorod.model.past import Past
from isorod.output import checkpoint
from isorod.statics.newton import Newton
from isorod.statics.path import Path, Step, Turn
from isorod.statics.predictor import Before


class Reached(NamedTuple):
    """Where load steps are: load factor, length of the next, updates of multipliers, and quick steps in a row.

    ``loose`` is the last load factor at which contact did not hold all.
    """

    factor: float
    step: float
    augmentations: int
    quick: int
    loose: float


class Kept(NamedTuple):
    """The file, seconds of wall time between two states that are kept at least, and whether to go on from there."""

    file: File
    every: float
    resume: bool


class Keeper:
    """Keeps where load steps are.

    Parameters
    ----------
    solver, path
        What takes them, and what becomes of them.
    kept
        Where and how often.
    told
        What else a run must have in common to continue.

    Raises
    ------
    InputError
        If the model has what is not kept.
    """

    def __init__(self, solver: Newton, path: Path, kept: Kept, told: tuple[Any, ...]) -> None:
        model = solver.assembler.model
        if model.contacts or model.coupled:
            raise InputError(
                "checkpoint: statics keeps none with contact, ties, mean supports or finite element bodies"
            )
        if not (np.isfinite(kept.every) and kept.every >= 0.0):
            raise InputError(f"time between checkpoints: got {kept.every:g}, need seconds, not negative")
        self._solver, self._path, self._kept = solver, path, kept
        self._comm = solver.assembler.comm.tompi4py()
        self._file = checkpoint.Kept(kept.file, lambda: _identity(model, told), self._comm)
        self._state: dict[str, Array] = {}
        self._saved = perf_counter()

    def begun(self, start: Reached) -> Reached:
        """Return where load steps begin: at the start, or where the file says."""
        found = self._file.begin(self._kept.resume)
        if found is not None:
            self._state = found | {"finished": np.array(False)}
            return self._restore(found)
        self._state = self._now(start)
        self._file.write(self._state)
        return start

    def note(self, reached: Reached) -> None:
        """Keep an equilibrium, if it is time for it; at the full load that before it, and that all is done."""
        if reached.factor == 1.0:
            self._file.write(self._state | {"finished": np.array(True)})
            return
        self._state = self._now(reached)
        if self._comm.bcast(perf_counter() - self._saved >= self._kept.every):
            self._file.write(self._state)
            self._saved = perf_counter()

    def keep(self) -> str:
        """Keep the last equilibrium of a run that is interrupted; return where it is, in words."""
        reached = self._solver.assembler.model.when(float(self._state["reached"][0]))
        return self._file.keep(lambda: self._state, reached)

    def close(self) -> None:
        """Let other runs have the file."""
        self._file.close()

    def _now(self, reached: Reached) -> dict[str, Array]:
        solver, path, assembler = self._solver, self._path, self._solver.assembler
        found = {
            "finished": np.array(False),
            "reached": np.array(reached),
            "counts": np.array([solver.iterations, solver.linear_iterations, solver.cuts, solver.solves]),
            "norms": np.array(solver.norms),
            "most": np.array(path.most),
            "x": assembler.all_unknowns(solver.x),
            "past_factors": np.array([one.factor for one in path.past]),
            "past": np.array([one.displacement for one in path.past]),
            "steps": np.array(len(path.steps)),
        }
        if solver.history is not None:
            found |= {"before_step": np.array(solver.history.step)}
            found |= {f"before_{name}": assembler.all_unknowns(getattr(solver.history, name)) for name in ("x", "rate")}
        for k, one in enumerate(path.steps):
            found |= {f"step_{k}_{name}": value for name, value in _flat(one._asdict()).items()}
        if path.largest is not None:
            turn = path.largest._asdict()
            own = turn.pop("carried")._asdict()
            found |= {f"turn_{name}": value for name, value in _flat(turn | own).items()}
        return found

    def _restore(self, found: dict[str, Array]) -> Reached:
        solver, path, assembler = self._solver, self._path, self._solver.assembler
        solver.iterations, solver.linear_iterations, solver.cuts, solver.solves = map(int, found["counts"])
        solver.norms, path.most = found["norms"].tolist(), float(found["most"])
        self._vector(found["x"]).copy(solver.x)
        if "before_step" in found:
            solver.history = Before(
                float(found["before_step"]), *(self._vector(found[f"before_{name}"]) for name in ("x", "rate"))
            )
        for factor, displacement in zip(found["past_factors"].tolist(), found["past"], strict=True):
            path.past.append(Past(factor, displacement))
            assembler.advance(assembler.state(displacement), factor)
        for k in range(int(found["steps"])):
            path.steps.append(Step(**self._whole(found, f"step_{k}_")))
        if "turn_factor" in found:
            turn = self._whole(found, "turn_")
            own = {name: turn.pop(name) for name in Carried._fields}
            path.largest = Turn(carried=Carried(**own), contacts=(), **turn)
        factor, step, augmentations, quick, loose = found["reached"].tolist()
        return Reached(factor, step, int(augmentations), int(quick), loose)

    def _vector(self, unknowns: Array) -> PETSc.Vec:
        x = self._solver.assembler.vector()
        x.array_w[:] = unknowns[slice(*x.getOwnershipRange())]
        return x

    def _whole(self, found: dict[str, Array], start: str) -> dict[str, Any]:
        """Return what `_flat` has made of a step."""
        own: dict[str, Any] = {name.removeprefix(start): one for name, one in found.items() if name.startswith(start)}
        own = {name: float(one) if one.ndim == 0 else one for name, one in own.items()}
        if "pressures" in own:
            own["pressures"] = self._solver.assembler.model.split_pressures(own["pressures"])
        return own | ({"solids": ()} if start == "turn_" else {}) | ({} if "pressures" in own else {"pressures": ()})


def _flat(values: dict[str, Any]) -> dict[str, Array]:
    """Return the arrays and numbers of a step by their names; pressures of all bodies in one."""
    found = {name: np.array(one) for name, one in values.items() if isinstance(one, float | np.ndarray)}
    pressures = [one.ravel() for one in values["pressures"] if one is not None]
    return found | ({"pressures": np.concatenate(pressures)} if pressures else {})


def _identity(model: Model, told: tuple[Any, ...]) -> dict[str, Any]:
    """Return what a checkpoint must have in common with a run."""
    from isorod.dynamics.explicit.mesh import digests, pack

    digest = hashlib.sha256(b"".join(digests(pack(model, moves=False))))
    digest.update(" ".join(law.identity for body in model.bodies for law in body.laws).encode())
    digest.update(repr((model.loads, model.spin, is_mixed(model))).encode())
    arrays: list[Any] = [model.held, model.free, model.external, np.array(model.stages)]
    arrays += [law.lame for body in model.bodies for law in body.laws]
    for one in model.motions:
        arrays += [one.turn, one.path]
        digest.update(repr(one.clock).encode())
    if model.times is not None:
        arrays += [model.times.path, model.times.times]
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return {"version": __version__, "analysis": "statics", "settings": repr(told), "model": digest.hexdigest()}
