"""Checkpoints of statics, from which load steps continue identically to the last bit."""

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
    """State of the load steps: load factor, length of the next, updates of multipliers, and quick steps in a row.

    ``loose`` is the last load factor at which contact did not hold all bodies.
    """

    factor: float
    step: float
    augmentations: int
    quick: int
    loose: float


class CheckpointOptions(NamedTuple):
    """The file, minimum wall time between two checkpoints in seconds, and whether to continue from it."""

    file: File
    every: float
    resume: bool


class CheckpointWriter:
    """Writes checkpoints of load steps.

    Parameters
    ----------
    solver, path
        Solver and path of the load steps.
    kept
        File and interval.
    settings
        Settings that a continued run must share.

    Raises
    ------
    InputError
        If checkpoints do not support the model.
    """

    def __init__(self, solver: Newton, path: Path, kept: CheckpointOptions, settings: tuple[Any, ...]) -> None:
        model = solver.assembler.model
        if model.contacts or model.coupled:
            raise InputError(
                "checkpoint: statics keeps none with contact, ties, mean supports or finite element bodies"
            )
        if not (np.isfinite(kept.every) and kept.every >= 0.0):
            raise InputError(f"time between checkpoints: got {kept.every:g}, need seconds, not negative")
        self._solver, self._path, self._kept = solver, path, kept
        self._comm = solver.assembler.comm.tompi4py()
        self._file = checkpoint.Kept(kept.file, lambda: _identity(model, settings), self._comm)
        self._state: dict[str, Array] = {}
        self._saved = perf_counter()

    def begun(self, start: Reached) -> Reached:
        """Return the state to begin at: the start, or that of the file."""
        stored = self._file.begin(self._kept.resume)
        if stored is not None:
            self._state = stored | {"finished": np.array(False)}
            return self._restore(stored)
        self._state = self._now(start)
        self._file.write(self._state)
        return start

    def note(self, reached: Reached) -> None:
        """Write an equilibrium, if it is time; at the full load the one before it, marked as finished."""
        if reached.factor == 1.0:
            self._file.write(self._state | {"finished": np.array(True)})
            return
        self._state = self._now(reached)
        if self._comm.bcast(perf_counter() - self._saved >= self._kept.every):
            self._file.write(self._state)
            self._saved = perf_counter()

    def keep(self) -> str:
        """Write the last equilibrium of an interrupted run; return a note on it."""
        reached = self._solver.assembler.model.when(float(self._state["reached"][0]))
        return self._file.keep(lambda: self._state, reached)

    def close(self) -> None:
        """Release the file."""
        self._file.close()

    def _now(self, reached: Reached) -> dict[str, Array]:
        solver, path, assembler = self._solver, self._path, self._solver.assembler
        state = {
            "finished": np.array(False),
            "reached": np.array(reached),
            "counts": np.array([solver.iterations, solver.linear_iterations, solver.cuts, solver.solves]),
            "norms": np.array(solver.norms),
            "most": np.array(path.most),
            "x": assembler.all_unknowns(solver.x),
            "past_factors": np.array([past.factor for past in path.past]),
            "past": np.array([past.displacement for past in path.past]),
            "steps": np.array(len(path.steps)),
        }
        if solver.history is not None:
            state |= {"before_step": np.array(solver.history.step)}
            state |= {f"before_{name}": assembler.all_unknowns(getattr(solver.history, name)) for name in ("x", "rate")}
        for k, step in enumerate(path.steps):
            state |= {f"step_{k}_{name}": value for name, value in _flat(step._asdict()).items()}
        if path.largest is not None:
            turn = path.largest._asdict()
            own = turn.pop("carried")._asdict()
            state |= {f"turn_{name}": value for name, value in _flat(turn | own).items()}
        return state

    def _restore(self, stored: dict[str, Array]) -> Reached:
        solver, path, assembler = self._solver, self._path, self._solver.assembler
        solver.iterations, solver.linear_iterations, solver.cuts, solver.solves = map(int, stored["counts"])
        solver.norms, path.most = stored["norms"].tolist(), float(stored["most"])
        self._vector(stored["x"]).copy(solver.x)
        if "before_step" in stored:
            solver.history = Before(
                float(stored["before_step"]), *(self._vector(stored[f"before_{name}"]) for name in ("x", "rate"))
            )
        for factor, displacement in zip(stored["past_factors"].tolist(), stored["past"], strict=True):
            path.past.append(Past(factor, displacement))
            assembler.advance(assembler.state(displacement), factor)
        for k in range(int(stored["steps"])):
            path.steps.append(Step(**self._unflattened(stored, f"step_{k}_")))
        if "turn_factor" in stored:
            turn = self._unflattened(stored, "turn_")
            own = {name: turn.pop(name) for name in Carried._fields}
            path.largest = Turn(carried=Carried(**own), contacts=(), **turn)
        factor, step, augmentations, quick, loose = stored["reached"].tolist()
        return Reached(factor, step, int(augmentations), int(quick), loose)

    def _vector(self, unknowns: Array) -> PETSc.Vec:
        x = self._solver.assembler.vector()
        x.array_w[:] = unknowns[slice(*x.getOwnershipRange())]
        return x

    def _unflattened(self, stored: dict[str, Array], start: str) -> dict[str, Any]:
        """Return the entries of a step that `_flat` returned."""
        own: dict[str, Any] = {
            name.removeprefix(start): float(value) if value.ndim == 0 else value
            for name, value in stored.items()
            if name.startswith(start)
        }
        if "pressures" in own:
            own["pressures"] = self._solver.assembler.model.split_pressures(own["pressures"])
        return own | ({"solids": ()} if start == "turn_" else {}) | ({} if "pressures" in own else {"pressures": ()})


def _flat(values: dict[str, Any]) -> dict[str, Array]:
    """Return the arrays and numbers of a step by their names; pressures of all bodies in one array."""
    arrays = {name: np.array(value) for name, value in values.items() if isinstance(value, float | np.ndarray)}
    pressures = [part.ravel() for part in values["pressures"] if part is not None]
    return arrays | ({"pressures": np.concatenate(pressures)} if pressures else {})


def _identity(model: Model, settings: tuple[Any, ...]) -> dict[str, Any]:
    """Return the properties in which checkpoint and run must agree."""
    from isorod.dynamics.explicit.mesh import digests, pack

    digest = hashlib.sha256(b"".join(digests(pack(model, moves=False))))
    digest.update(" ".join(law.identity for body in model.bodies for law in body.laws).encode())
    digest.update(repr((model.loads, model.spin, is_mixed(model))).encode())
    arrays: list[Any] = [model.held, model.free, model.external, np.array(model.stages)]
    arrays += [law.lame for body in model.bodies for law in body.laws]
    for motion in model.motions:
        arrays += [motion.turn, motion.path]
        digest.update(repr(motion.clock).encode())
    if model.times is not None:
        arrays += [model.times.path, model.times.times]
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return {"version": __version__, "analysis": "statics", "settings": repr(settings), "model": digest.hexdigest()}
