"""CalculiX run on an input file: what it printed, and how long it took beyond reading its model."""

import os
import re
import resource
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from comparisons.calculix import deck
from comparisons.measure import timing
from isorod.errors import InputError, SolveError
from meshes.mesh import Array

PROGRAM = "ccx"


@dataclass(frozen=True, eq=False)
class Result:
    """What CalculiX printed.

    Attributes
    ----------
    data
        Its file of printed results.
    said
        Its standard output.
    seconds
        ``solve`` is what remains of its time without ``read``: that of a run that only reads the model.
    """

    data: str
    said: str
    seconds: dict[str, float]

    @property
    def iterations(self) -> int:
        """Number of Newton steps."""
        return len(re.findall(r"^ iteration ", self.said, re.MULTILINE))

    def totals(self) -> Array:
        """Return the sums of forces that were printed, shape ``(sets, 3)``."""
        rows = re.findall(r"total force.*\n\n(.*)\n", self.data)
        return np.array([[float(word) for word in row.split()] for row in rows])

    def frequencies(self) -> Array:
        """Return the frequencies, cycles per time."""
        table = self.data.split("P A R T I C I P A T I O N")[0].splitlines()
        rows = [line.split() for line in table if re.match(r"\s+\d+\s+[-.\d]", line)]
        return np.array([float(row[3]) for row in rows])


def version() -> str:
    """Return the version of the program; raises `InputError` if there is none."""
    if shutil.which(PROGRAM) is None:
        raise InputError(f"CalculiX: no program {PROGRAM} on PATH; docker/opponents installs it (Debian: calculix-ccx)")
    said = subprocess.run([PROGRAM, "-v"], capture_output=True, text=True, check=False).stdout
    return said.split()[-1]


def solve(body: str, step: str) -> Result:
    """Return what a step on a body gives, in a folder of its own that is then removed.

    Raises
    ------
    SolveError
        With the error that CalculiX names.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "model.inp").write_text(f"{body}\n{deck.NOTHING}\n")
        (folder / "whole.inp").write_text(f"{body}\n{step}\n")
        _, reading, idle = _run(folder, "model")
        said, whole, busy = _run(folder, "whole")
        data = (folder / "whole.dat").read_text() if (folder / "whole.dat").exists() else ""
    wrong = re.search(r"\*ERROR[^\n]*(\n +\S[^\n]*)?", said)
    if wrong or not data.strip():
        raise SolveError(f"CalculiX: {' '.join(wrong[0].split()) if wrong else 'it printed no result'}")
    solving = max(whole - reading, 0.0)
    seconds = {"read": reading, "setup": 0.0, "assembly": 0.0, "solve": solving}
    return Result(data, said, seconds | {"total": solving, "processor": max(busy - idle, 0.0), "process": whole})


def _run(folder: Path, job: str) -> tuple[str, float, float]:
    """Return what a run says, and its wall and processor time."""
    before, start = _children(), perf_counter()
    done = subprocess.run(
        [PROGRAM, job], cwd=folder, env=timing.environment(), capture_output=True, text=True, check=False
    )
    return done.stdout + done.stderr, perf_counter() - start, _children() - before


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def peak_memory() -> int:
    """Return the largest resident set of CalculiX so far, bytes."""
    return 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss


def where() -> str:
    """Return the path of the program, or nothing."""
    return shutil.which(PROGRAM, path=os.environ.get("PATH")) or ""
