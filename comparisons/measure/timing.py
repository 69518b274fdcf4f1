"""Fair timing: every measurement in a process of its own, one thread a rank, set-up, assembly and solve apart."""

import json
import os
import resource
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from isorod.errors import SolveError


def environment() -> dict[str, str]:
    """Return the environment of a measurement: one thread a rank, and mpirun willing to run as root."""
    fixed = {
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "PYTHONNOUSERSITE": "1",
    }
    return os.environ | fixed


def run(module: str, arguments: Sequence[str], ranks: int = 1, timeout: float = 3600.0) -> dict[str, Any]:
    """Run ``python -m module`` in a process of its own and return the JSON record that it prints last.

    Raises
    ------
    SolveError
        With the last line of what it said, if it fails.
    """
    command = [sys.executable, "-m", module, *arguments]
    if ranks > 1:
        command = ["mpirun", "--oversubscribe", "-n", str(ranks), *command]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), timeout=timeout, check=False)
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["nothing said"])[-1]
        raise SolveError(f"python -m {module} {' '.join(arguments)}: exit code {done.returncode}: {said}")
    record: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return record


class Clock:
    """Wall time by part, in ``seconds``.  Time between `resume` and the `lap` before it counts for no part."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.resume()

    def resume(self) -> None:
        """Start anew from here."""
        self._last = perf_counter()

    def lap(self, part: str) -> None:
        """Add the time since the last call to a part."""
        now = perf_counter()
        self.seconds[part] = self.seconds.get(part, 0.0) + now - self._last
        self._last = now


def peak_memory() -> int:
    """Return the largest resident set of this process so far, bytes.

    Not ``ru_maxrss``: that starts from the parent's, which is larger where a study starts the measurement.
    """
    for text in Path("/proc/self/status").read_text().splitlines():
        if text.startswith("VmHWM:"):
            return 1024 * int(text.split()[1])
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
