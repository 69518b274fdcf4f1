"""Solver options for spring, blade and biceps statics.

Every line as it goes behind ``isorod run``, in a process of its own.

At full level what works is timed once more, warm, in another process (`comparisons.measure.rod`).
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from comparisons.measure import timing
from comparisons.measure.records import Record
from comparisons.stability.figure import COLOURS
from comparisons.stability.point import holds, sweeps
from isorod.errors import SolveError
from isorod.output.results import write_beside

NAME = "tuning"
TITLE = "solver options for spring, blade and biceps statics"
COLUMNS = {
    "line": "isorod run ...",
    "milliseconds": "ms",
    "processor": "ms of the processor",
    "newton": "Newton iterations",
    "linear": "Krylov iterations",
    "restarts": "eigensolver iterations",
    "cuts": "cut steps",
}

# Results with other solvers agree to this; SNES stops at 1e-9 of the load, LOBPCG at 1e-7.
TOLERANCE = 1e-6

# Seconds after which a run is given up, and warm runs whose median is the time (none: the time of the command's own,
# cold run).
TIME_LIMIT = {"quick": 15.0, "full": 120.0}
WARM = {"quick": 0, "full": 3}

# A run of this many seconds is not repeated: what only the first one pays does not show.
LONG = 10.0

# A line is recommended in place of the default if it takes less than this share of its time.
FASTER = 0.9

DIRECT = {
    "LU, MUMPS": "-pc_type lu -pc_factor_mat_solver_type mumps",
    "Cholesky, MUMPS": "-pc_type cholesky -pc_factor_mat_solver_type mumps",
    "LU, SuperLU_DIST": "-pc_type lu -pc_factor_mat_solver_type superlu_dist",
    "LU, PETSc, natural ordering": "-pc_type lu -pc_factor_mat_solver_type petsc -pc_factor_mat_ordering_type natural",
    "LU, PETSc, nested dissection": "-pc_type lu -pc_factor_mat_solver_type petsc -pc_factor_mat_ordering_type nd",
    "Cholesky, PETSc": "-pc_type cholesky -pc_factor_mat_solver_type petsc -pc_factor_mat_ordering_type natural",
}
KRYLOV = {
    "GMRES + ILU": "-ksp_type gmres -pc_type ilu",
    "GMRES + ILU(2)": "-ksp_type gmres -pc_type ilu -pc_factor_levels 2",
    "CG + ICC": "-ksp_type cg -pc_type icc",
    "CG + GAMG": "-ksp_type cg -pc_type gamg",
    "GMRES + GAMG": "-ksp_type gmres -pc_type gamg",
    "CG + block Jacobi": "-ksp_type cg -pc_type bjacobi",
    "CG + point block Jacobi": "-ksp_type cg -pc_type pbjacobi",
    "CG + Jacobi": "-ksp_type cg -pc_type jacobi",
}
NONLINEAR = {
    "Newton, line search bt": "-snes_type newtonls -snes_linesearch_type bt",
    "Newton, line search l2": "-snes_type newtonls -snes_linesearch_type l2",
    "Newton, line search cp": "-snes_type newtonls -snes_linesearch_type cp",
    "trust region": "-snes_type newtontr",
    "quasi-Newton": "-snes_type qn -snes_qn_scale_type jacobian -snes_max_it 200",
}
EIGEN = {
    "Krylov-Schur, LU, MUMPS": "-eps_type krylovschur -st_pc_type lu -st_pc_factor_mat_solver_type mumps",
    "Krylov-Schur, Cholesky, MUMPS": "-eps_type krylovschur -st_pc_type cholesky -st_pc_factor_mat_solver_type mumps",
    "Krylov-Schur, LU, SuperLU_DIST": "-eps_type krylovschur -st_pc_type lu -st_pc_factor_mat_solver_type superlu_dist",
    "Krylov-Schur, LU, PETSc": "-eps_type krylovschur -st_pc_type lu -st_pc_factor_mat_solver_type petsc",
    "Krylov-Schur, CG + ICC": "-eps_type krylovschur -st_ksp_type cg -st_ksp_rtol 1e-11 -st_pc_type icc",
    "Krylov-Schur, CG + GAMG": "-eps_type krylovschur -st_ksp_type cg -st_ksp_rtol 1e-11 -st_pc_type gamg",
    "Lanczos": "-eps_type lanczos -eps_lanczos_reorthog full",
    "Arnoldi": "-eps_type arnoldi",
    "subspace iteration": "-eps_type subspace",
    "LOBPCG": "-eps_type lobpcg",
    "Jacobi-Davidson": "-eps_type jd",
    "generalised Davidson": "-eps_type gd",
}
DEFAULT = "default"
PAPER = "--preset paper --no-estimate"
STATICS = {DEFAULT: "", **DIRECT, **KRYLOV, **NONLINEAR}
MODES = {DEFAULT: "", **EIGEN}
CASES = {
    "full": {
        f"spring {PAPER}": STATICS,
        f"spring {PAPER} --order 2 --section-points 12 --elements-per-turn 12": STATICS,
        f"blade {PAPER}": MODES,
        f"blade {PAPER} --order 2 --degree 3": MODES,
        "biceps --statics": STATICS,
    },
    "quick": {
        f"spring {PAPER}": {name: STATICS[name] for name in (DEFAULT, "Cholesky, MUMPS", "CG + GAMG", "quasi-Newton")},
        f"blade {PAPER}": {name: MODES[name] for name in (DEFAULT, "LOBPCG", "Lanczos")},
        "biceps --statics --elements 5 --end-elements 0": {name: STATICS[name] for name in (DEFAULT, "trust region")},
    },
}


def LIMITS(records: list[Record]) -> list[str]:
    """Return the recommended line of each case, from the records."""
    lines = []
    for case, curves in sweeps(records).items():
        points = [one for curve in curves.values() for one in curve]
        default = points[0]
        good = [one for one in points if holds(one)]
        if not good:
            lines.append(f"{case}: nothing holds.")
            continue
        best = min(good, key=lambda one: one["milliseconds"])
        # Cold times of one run decide nothing.
        keep = holds(default) and (
            not (default["warm"] or default["milliseconds"] > 1e3 * LONG)
            or best["milliseconds"] > FASTER * default["milliseconds"]
        )
        pick = default if keep else best
        beside = "" if keep or not holds(default) else f" (the default takes {default['milliseconds']:.0f} ms)"
        failed = ", ".join(str(one["value"]) for one in points if not holds(one))
        lines.append(
            f"{case}: recommended `isorod run {pick['line']}`, {pick['milliseconds']:.0f} ms{beside}; {len(good)} of "
            f"{len(points)} "
            f"lines give the same to {TOLERANCE:g}" + (f", not: {failed}." if failed else ".")
        )
    return lines


def run(level: str) -> Iterator[dict[str, Any]]:
    """Yield the points: one a line of options."""
    for case, lines in CASES[level].items():
        reference: np.ndarray | None = None
        for name, line in lines.items():
            whole = f"{case} {line}".strip()
            start = perf_counter()
            found = _command(whole, TIME_LIMIT[level], WARM[level])
            values = found.pop("values", None)
            if reference is None:
                reference = values
            if values is not None and reference is not None:
                found["error"] = float(np.max(np.abs(values / reference - 1.0)))
            elif values is not None:
                found["failure"] = "there is no default to compare with"
            yield {
                "sweep": case,
                "value": name,
                "line": whole,
                **found,
                "reference": "the default options",
                "tolerance": TOLERANCE,
                "seconds": perf_counter() - start,
            }


def _command(line: str, limit: float, warm: int) -> dict[str, Any]:
    """Run ``isorod run`` with a line; return what the record says, or the ``failure`` and the exit ``code``."""
    program = [sys.executable, "-c", "import sys; from isorod.command.cli import main; sys.exit(main())"]
    try:
        done = subprocess.run(
            [*program, "run", *line.split(), "--json"],
            capture_output=True,
            text=True,
            env=timing.environment(),
            timeout=limit,
            check=False,
        )
        said = done.stderr.strip().splitlines()
        if done.returncode:
            return {"failure": said[-1] if said else "nothing said", "code": done.returncode, "said": len(said)}
        record = json.loads(done.stdout.strip().splitlines()[-1])
        seconds, more = record["seconds"]["total"], {}
        warm = warm if seconds < LONG else 0
        if warm:
            # Which makes no estimate unless it is asked for.
            words = [word for word in line.split() if word != "--no-estimate"]
            again = timing.run(
                "comparisons.measure.rod", [*words, "--repeat", str(warm + 1)], timeout=limit * (warm + 1)
            )
            seconds = again["seconds"]["total"]
            # What a machine that is busy with other work tells best.
            more = {"processor": 1e3 * again["seconds"]["processor"]}
    except subprocess.TimeoutExpired:
        return {"failure": f"no result within {limit:g} s", "code": None}
    except SolveError as problem:
        # Seen with SuperLU_DIST 8.1.2, which corrupts memory when it factorises again and again.
        return {"failure": f"right once, but run again in one process: {str(problem).split(': ', 1)[1]}", "code": None}
    found: dict[str, Any] = {"milliseconds": 1e3 * seconds, **more, "warm": warm > 0}
    if record["analysis"] == "modal":
        return found | {"values": np.array(record["frequencies"]), "restarts": record["iterations"]}
    values = record["end_force"] if "end_force" in record else [record["force"]]
    return found | {
        "values": np.array(values),
        "newton": record["newton_iterations"],
        "linear": record["linear_iterations"],
        "cuts": record["cuts"],
    }


def plot(records: list[Record], path: Path) -> None:
    """Draw the time of each line, case by case; what failed stands at the left edge with its reason."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot, ticker

    cases = sweeps(records)
    counts = [sum(map(len, curves.values())) for curves in cases.values()]
    figure, axes = pyplot.subplots(
        len(cases), 1, figsize=(11.0, 0.28 * sum(counts) + 1.1 * len(cases)), layout="constrained", squeeze=False,
        height_ratios=counts,
    )  # fmt: skip
    for axis, (case, curves) in zip(axes[:, 0], cases.items(), strict=True):
        points = [one for curve in curves.values() for one in curve]
        times = [one.get("milliseconds", 0.0) for one in points]
        smallest = min(time for time in times if time > 0.0) if any(times) else 1.0
        for k, one in enumerate(points):
            if "milliseconds" in one:
                axis.barh(k, one["milliseconds"], color=COLOURS[0 if holds(one) else 4])
            else:
                reason = one["failure"].removeprefix("isorod: ")
                axis.text(0.6 * smallest, k, f" × {reason[:95]}", va="center", fontsize="small", color=COLOURS[1])
        axis.set_yticks(range(len(points)), [str(one["value"]) for one in points])
        axis.set_ylim(len(points) - 0.4, -0.6)
        axis.set_xscale("log")
        axis.xaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.xaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_formatter(ticker.NullFormatter())
        axis.set_xlim(left=0.5 * smallest)
        axis.set_title(f"isorod run {case}", fontsize="medium", loc="left")
        axis.grid(True, axis="x", which="both", alpha=0.25)
    axes[-1, 0].set_xlabel(
        f"set-up + assembly + solve [ms]; orange: differs from the default by more than {TOLERANCE:g}"
    )
    write_beside(path, lambda where: figure.savefig(where, dpi=110))
    pyplot.close(figure)
