"""Ranks that wait for calls of functions of test files: to start them takes longer than most of what they are asked."""

import json
import os
import select
import subprocess
import sys
import time
from pathlib import Path

# One pipe each, since a rank that waits for others in MPI takes all of a processor. One that fails takes all with it.
EACH = """
import isorod, importlib, json, os, sys, traceback, warnings
sys.path[:0] = [{here!r}]
from petsc4py import PETSc
with open(f"{folder}/calls-{{PETSc.COMM_WORLD.getRank()}}") as calls:
    for line in calls:
        (call, *sys.argv[1:]), module = json.loads(line), json.loads(line)[0].partition(".")[0]
        try:
            with warnings.catch_warnings():
                exec(call, {{"sys": sys, module: importlib.import_module(module)}})
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
            os._exit(1)
        with open("{folder}/done", "w") as done:
            print(PETSc.COMM_WORLD.getRank(), file=done)
"""


class Ranks:
    """Ranks started by ``launcher``, which write what they say to a file of ``folder``."""

    def __init__(self, launcher: list[str], count: int, folder: Path) -> None:
        self.count, self._said, names = count, folder / "said", [f"calls-{rank}" for rank in range(count)]
        for name in ("done", *names):
            os.mkfifo(folder / name)
        script = EACH.format(here=os.path.dirname(__file__), folder=folder)
        words = [*launcher, str(count), sys.executable, "-c", script]
        # The environment as Python knows it: Open MPI, once started here, adds variables that would confuse another.
        own = {"env": dict(os.environ), "stdin": subprocess.DEVNULL}
        with open(self._said, "a") as said:
            self._process = subprocess.Popen(words, stdout=said, stderr=said, **own)
        # For reading and writing: neither waits for a rank that may have ended.
        self._pipes = [os.open(folder / name, os.O_RDWR) for name in ("done", *names)]

    @property
    def alive(self) -> bool:
        """Whether they can be called."""
        return self._process.poll() is None

    def __call__(self, call: str, *arguments: str, timeout: float = 300.0) -> None:
        """Have each rank make a call, behind whose arguments ``sys.argv`` has others; what fails is told."""
        os.truncate(self._said, 0)
        done, *calls = self._pipes
        for pipe in calls:
            os.write(pipe, f"{json.dumps([call, *arguments])}\n".encode())
        answers, end = 0, time.monotonic() + timeout
        while answers < self.count and self.alive and time.monotonic() < end:
            if select.select([done], [], [], 0.5)[0]:
                answers += os.read(done, 1 << 16).count(b"\n")
        if answers < self.count:
            self.end()
            raise AssertionError(f"{call} on {self.count} ranks:\n{self._said.read_text(errors='replace')}")

    def end(self) -> None:
        """End them."""
        self._process.terminate()
        self._process.wait()
        while self._pipes:
            os.close(self._pipes.pop())
