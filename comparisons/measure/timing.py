"""Fair timing: every measurement in a process of its own, one thread a rank, set-up, assembly and solve apart."""

import gc
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter, process_time
from typing import Any, Protocol, TypeVar

from isorod.errors import InputError, SolveError

# What another interpreter needs of this one: the sources, and nothing else.
_CHECKOUT = Path(__file__).parents[2]


class Timed(Protocol):
    """A result, and the wall time of the parts of its computation."""

    @property
    def seconds(self) -> dict[str, float]:
        """Wall time by part."""


Result = TypeVar("Result", bound=Timed)


class Failed(SolveError):
    """A measurement that failed; ``last_line`` is the last one of its output."""

    def __init__(self, message: str, last_line: str) -> None:
        super().__init__(message)
        self.last_line = last_line


def environment(interpreter: str = sys.executable) -> dict[str, str]:
    """Return the environment of a measurement: one thread a rank, and mpirun willing to run as root.

    Another interpreter gets its own programs first, such as its compiler, and its own packages.
    """
    fixed = {
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "PYTHONNOUSERSITE": "1",
    }
    if interpreter != sys.executable:
        fixed["PATH"] = os.pathsep.join((os.path.dirname(interpreter), os.environ.get("PATH", os.defpath)))
        fixed["PYTHONPATH"] = os.pathsep.join(map(str, (_CHECKOUT / "src", _CHECKOUT)))
    return os.environ | fixed


def find_dolfinx(program: str) -> tuple[str, str]:
    """Return the path of another Python interpreter, and the version of dolfinx that it has.

    Raises
    ------
    InputError
        If there is no such program, or ``comparisons.fem`` does not run with it.
    """
    interpreter = shutil.which(program)
    if interpreter is None:
        raise InputError(f"--dolfinx {program}: no such program; name the Python of an environment that has dolfinx")
    # Not what links lead to: a virtual environment is known by the name it is started with.
    interpreter = os.path.abspath(interpreter)
    # Wheels of dolfinx find MPI where mpi4py has loaded it.
    script = "import mpi4py.MPI, comparisons.fem.published, dolfinx; print(dolfinx.__version__)"
    done = subprocess.run(
        [interpreter, "-c", script], capture_output=True, text=True, env=environment(interpreter), check=False
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no output"])[-1]
        raise InputError(f"--dolfinx {program}: finite elements do not run there ({last}); it needs dolfinx and numba")
    return interpreter, done.stdout.strip().splitlines()[-1]


def run(
    module: str,
    arguments: Sequence[str],
    ranks: int = 1,
    timeout: float = 3600.0,
    interpreter: str = sys.executable,
) -> dict[str, Any]:
    """Run ``python -m module`` in a process of its own and return the JSON record that it prints last.

    Raises
    ------
    Failed
        With the last line of its output, if it fails, or when it takes too long.
    """
    command = [interpreter, "-m", module, *arguments]
    if ranks > 1:
        command = ["mpirun", "--oversubscribe", "-n", str(ranks), *command]
    around = environment(interpreter)
    asked = f"python -m {module} {' '.join(arguments)}"
    try:
        done = subprocess.run(command, capture_output=True, text=True, env=around, timeout=timeout, check=False)
    except subprocess.TimeoutExpired:
        late = f"not done after {timeout:g} s"
        raise Failed(f"{asked}: {late}", late) from None
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no output"])[-1]
        raise Failed(f"{asked}: exit code {done.returncode}: {last}", last.removeprefix(f"{module}: "))
    record: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return record


def repeated(
    solve: Callable[[], Result], repeat: int, begin: Callable[[], object] = gc.collect
) -> tuple[Result, list[dict[str, float]]]:
    """Solve ``repeat`` times in this process.

    Returns the result of the last run, and the seconds of each run by part.  ``total`` is all of a run, checks of its
    result included, ``processor`` its processor time; what comes before it, ``begin``, does not count.
    """
    runs: list[dict[str, float]] = []
    result: Result | None = None
    for _ in range(repeat):
        # The last run's garbage does not count as the next one's.
        result = None
        begin()
        start, worked = perf_counter(), process_time()
        result = solve()
        parts = dict(result.seconds)
        runs.append(parts | {"total": perf_counter() - start, "processor": process_time() - worked})
    assert result is not None
    return result, runs


def median(runs: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the medians, by part, over the warm runs (all but the first), or the only run."""
    warm = runs[1:] or runs
    return {name: statistics.median(one[name] for one in warm) for name in runs[0]}


def least(works: Sequence[Callable[[], object]], turns: int) -> list[float]:
    """Return the least processor time of each function, called in turn so many times."""
    times: list[list[float]] = [[] for _ in works]
    for _ in range(turns):
        for work, own in zip(works, times, strict=True):
            start = process_time()
            work()
            own.append(process_time() - start)
    return [min(own) for own in times]


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
