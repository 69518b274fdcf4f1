"""The biceps: error of the end forces of explicit dynamics against its time, isorod and dolfinx.

Of a motion that comes to rest the end forces are those of the equilibrium on its mesh.  Finite elements are not run to
the end of it, which takes hours: their time is that of a measured step by the number of steps, without samples and
critical steps.
"""

import numpy as np

from comparisons.biceps import END_TIME
from comparisons.fem.presets import biceps as presets
from comparisons.measure import timing
from comparisons.measure.convergence import time_at
from comparisons.measure.records import Record
from comparisons.measure.study import Run, Steps
from comparisons.measure.work import AS_RUN

# Largest error of the end forces.
TARGET = 1e-2

# Meshes of explicit dynamics by curve, coarse to fine.
MESHES = {
    "quick": {
        "P1 tetrahedra": ("--degree 1 --size 0.5", "--degree 1 --size 0.3325"),
        "Q2 bricks": presets.CONVERGED.arguments[:2],
    },
    "full": {
        "P1 tetrahedra": tuple(f"--degree 1 --size {size}" for size in (0.5, 0.3325, 0.25, 0.2)),
        "P2 tetrahedra": tuple(f"--degree 2 --size {size}" for size in (0.7, 0.5, 0.3325)),
        "Q1 bricks": tuple(
            f"--cells bricks --degree 1 --around {n} --layers {m}" for n, m in ((8, 8), (12, 12), (16, 16))
        ),
        "Q2 bricks": presets.CONVERGED.arguments[:3],
    },
}
# The mesh whose equilibrium is the reference: finer ones differ from it by 0.04 %.
REFERENCE = {"quick": presets.CONVERGED.arguments[1], "full": presets.CONVERGED.arguments[2]}

# Seconds of motion that a step is measured in, and its samples.
SHORT, OUTPUTS = 5e-4, 2

# Of isorod: the motion to rest.  Four control points round a branch do as well as eight (0.53 % and 0.40 % off).  A
# tenth of a millisecond costs the contracted muscle's frequencies below 300 Hz 2 %, and what it costs grows with the
# square of the step: an eighth 3 %.
OURS = (
    "--order 1",
    *AS_RUN.arguments,
    "--order 2 --section-points 6 --time-step 1e-4",
    "--order 2 --section-points 4 --time-step 1.25e-4",
)
_MOTION = f"--end-time {END_TIME:g} --outputs 10"


def steps(level: str) -> int:
    """Return the number of steps that `run` shows."""
    return 2 * sum(map(len, MESHES[level].values())) + len(OURS) + (REFERENCE[level] not in _every(level))


def _every(level: str) -> list[str]:
    return [one for meshes in MESHES[level].values() for one in meshes]


def run(study: Run, steps: Steps) -> None:
    """Record error and time of every mesh, and of isorod's spaces."""
    level = study.level
    rests: dict[str, Record] = {}
    for arguments in dict.fromkeys([REFERENCE[level], *_every(level)]):
        with steps.step(f"biceps, equilibrium: {arguments}"):
            rests[arguments] = timing.run("comparisons.fem", ["biceps", *arguments.split()])
    target = rests[REFERENCE[level]]["end_force"]
    study.record("converged", {"scene": "biceps", "end_force": target, "arguments": REFERENCE[level]})
    for curve, meshes in MESHES[level].items():
        for arguments in meshes:
            with steps.step(f"biceps, steps: {arguments}"):
                words = [*arguments.split(), "--analysis", "dynamics", "--end-time", f"{SHORT:g}"]
                record = timing.run("comparisons.fem", ["biceps", *words, "--outputs", str(OUTPUTS)])
            total = record["seconds"]["step"] * END_TIME / record["time_step"]
            values = {"curve": curve, "arguments": arguments, "seconds_motion": total}
            error = _error(rests[arguments]["end_force"], target)
            study.record("motion", {key: value for key, value in record.items() if key != "history"} | values | error)
    for arguments in OURS:
        with steps.step(f"biceps, motion: isorod {arguments}"):
            typed = arguments if arguments in AS_RUN.arguments else f"{arguments} {_MOTION}"
            record = timing.run("comparisons.measure.rod", ["biceps", *typed.split(), "--repeat", "4"])
        # Without outputs, their balances and critical steps, as theirs.
        bare = record["seconds"]["setup"] + record["seconds"]["loop"]
        values = {"curve": "isorod", "arguments": typed, "seconds_steps": bare}
        values["seconds_motion"] = record["seconds"]["total"]
        study.record("motion", _short(record) | values | _error(record["end_force"], target))


def _short(record: Record) -> Record:
    """Return a record without courses in time."""
    return {key: value for key, value in record.items() if not (isinstance(value, list) and len(value) > 8)}


def _error(forces: object, target: object) -> dict[str, float]:
    return {"error": float(np.max(np.abs(np.array(forces) / np.array(target) - 1.0)))}


def at(records: list[Record], target: float) -> float | None:
    """Return the time that a curve takes to an error; None where it does not reach it."""
    errors, times = ([one[name] for one in records] for name in ("error", "seconds_motion"))
    time, how = time_at(errors, times, target)
    return None if how == "more than" else time
