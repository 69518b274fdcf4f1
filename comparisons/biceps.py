"""Study ``biceps``: Figs. 14-16 of Lu & Zhou (2011), two muscles in contact beside finite elements."""

from pathlib import Path
from typing import Any

import numpy as np

from comparisons.fem.presets import biceps as presets
from comparisons.measure import timing
from comparisons.measure.convergence import limits
from comparisons.measure.records import Record
from comparisons.measure.study import Run, Steps
from comparisons.report import biceps_pictures
from isorod import options
from isorod.command import solving
from isorod.dynamics import History
from isorod.output.results import write_arrays
from isorod.scenes.biceps import Biceps
from isorod.statics import Equilibrium

# What is compared at the equilibrium, and the deviation from the converged finite elements it may have.
QUANTITIES = {"end_force": 0.02, "belly_bulge": 0.02, "contact_force": 0.05}

# Deviation of the motion's end forces after `END_TIME` from the equilibrium's, and errors of energy and momentum in
# fractions of the work done.
AT_REST, BALANCE = 5e-3, 1e-3
END_TIME = 0.25

# Uniformly refined meshes whose extrapolated values are the reference.
CONVERGED = {
    "quick": presets.CONVERGED.arguments[:2],
    "full": presets.CONVERGED.arguments[:3],
}
# The mesh of pictures and courses, one of these.
BRICKS = {"quick": CONVERGED["quick"][0], "full": CONVERGED["full"][1]}
# The motion: with the paper's element refined, and with biharmonic functions of the section, in the paper's time steps.
MOTIONS: dict[str, dict[str, Any]] = {f"K = {order}": {"order": order, "time_step": 2.5e-5} for order in (1, 2)}
PICTURED = "K = 2"
INTERVALS = 500

# Seconds and samples of the finite elements' motion.
LONG = {"quick": (0.015, 15), "full": (0.030, 60)}


def run(study: Run) -> None:
    """Run the study and append its records."""
    options.initialize([])
    with study.progress(len(CONVERGED[study.level]) + len(MOTIONS) + 2) as steps:
        _converged(study, steps)
        _motions(study, steps)
        _fem_motion(study, steps)
        with steps.step("pictures"):
            biceps_pictures.run(study, Biceps(**MOTIONS[PICTURED]))


def errors(record: Record, reference: Record) -> dict[str, float]:
    """Return the relative error of each of `QUANTITIES`, of the end forces the largest."""
    return {
        name: float(np.max(np.abs(np.array(record[name]) / np.array(reference[name]) - 1.0))) for name in QUANTITIES
    }


def _converged(study: Run, steps: Steps) -> None:
    """Record equilibria on finer and finer meshes, and their limits."""
    label, records = presets.CONVERGED.label, []
    for arguments in CONVERGED[study.level]:
        with steps.step(f"equilibrium, {label} {arguments}"):
            words = ["biceps", *arguments.split()]
            if arguments == BRICKS[study.level]:
                words += ["--fields", str(study.folder / biceps_pictures.FEM_REST)]
            record = timing.run("comparisons.fem", words) | {"arguments": arguments, "curve": label}
            records.append(study.record("convergence", record))
    values: Record = {}
    summaries: dict[str, Any] = {}
    for name, every in limits(records, QUANTITIES).items():
        value = [limit.value for limit in every]
        values[name] = value if name == "end_force" else value[0]
        worst = max(every, key=lambda limit: limit.distance / abs(limit.value))
        summaries[name] = {"order": worst.order, "uncertainty": worst.distance / abs(worst.value)}
    study.record("converged", values | {"limits": summaries, "element": label})


def _motions(study: Run, steps: Steps) -> None:
    """Record the whole motion and how near it ends to its own equilibrium; one goes to a file for pictures."""
    for label, values in MOTIONS.items():
        with steps.step(f"motion to {END_TIME:g} s, {label}"):
            scene = Biceps(**values, end_time=END_TIME, outputs=INTERVALS)
            settings = scene.settings()
            history, seconds = solving.solve(scene, settings)
            still, _ = solving.solve(Biceps(**values, statics=True), {})
            rest = scene.measure(still)
            record = solving.record(scene, history, seconds, settings) | {"label": label, "equilibrium": rest}
            record["equilibrium"]["contact_area"] = still.contacts[0].area
            record["from_equilibrium"] = errors(record | {"contact_force": float(history.contact_force[-1])}, rest)
            # Forces of supports by their size, as the equilibrium has them.
            record["end_force_history"] = np.linalg.norm(history.reactions, axis=2)
            study.record("motion", record)
            if label == PICTURED:
                _save(study.folder / biceps_pictures.MOTION, history, still)


def _save(path: Path, history: History, still: Equilibrium) -> None:
    """Write ``times`` ``(o,)``, ``displacement`` ``(o, dofs)`` and ``equilibrium`` ``(dofs,)`` to an ``.npz`` file."""
    # Pictures need no more digits.
    displacement = history.displacement.astype(np.float32)
    write_arrays(path, times=history.times, displacement=displacement, equilibrium=still.displacement)


def _fem_motion(study: Run, steps: Steps) -> None:
    """Record a part of the motion on bricks, whose fields go to a file for pictures."""
    end, outputs = LONG[study.level]
    with steps.step(f"motion to {end:g} s, bricks"):
        words = [*BRICKS[study.level].split(), "--analysis", "dynamics"]
        words += ["--end-time", str(end), "--outputs", str(outputs)]
        file = study.folder / biceps_pictures.FEM_MOTION
        record = timing.run("comparisons.fem", ["biceps", *words, "--fields", str(file)])
        study.record("fem motion", record | {"label": "Q2 bricks", "arguments": " ".join(words), "file": file.name})
