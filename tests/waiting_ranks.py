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
import isorod, io, json, os, sys, traceback, warnings
from contextlib import redirect_stderr, redirect_stdout
sys.path[:0] = [{here!r}]
from petsc4py import PETSc
rank = PETSc.COMM_WORLD.getRank()
with open(f"{folder}/calls-{{rank}}") as calls:
    for line in calls:
        call, *sys.argv[1:] = json.loads(line)
        module, printed = call.partition("(")[0].rpartition(".")[0], io.StringIO()
        try:
            with warnings.catch_warnings(), redirect_stdout(printed), redirect_stderr(printed):
                exec(call, {{"sys": sys, module.partition(".")[0]: __import__(module)}})
        except BaseException:
            print(printed.getvalue(), traceback.format_exc(), file=sys.stderr, flush=True)
            os._exit(1)
        # By a file: what the launcher passes on comes when it comes.
        with open(f"{folder}/printed-{{rank}}", "w") as file:
            file.write(printed.getvalue())
        with open("{folder}/done", "w") as done:
            print(rank, file=done)
"""


class Ranks:
    """Ranks started by ``launcher``, which write what they say to a file of ``folder``."""

    def __init__(self, launcher: list[str], count: int, folder: Path) -> None:
        self.count, self._said, names = count, folder / "said", [f"calls-{rank}" for rank in range(count)]
        self._printed = [folder / f"printed-{rank}" for rank in range(count)]
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

    def __call__(self, call: str, *arguments: str, timeout: float = 300.0) -> str:
        """Have each rank make a call, for which ``sys.argv`` has the arguments; return what they print."""
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
        return "".join(file.read_text() for file in self._printed)

    def end(self) -> None:
        """End them."""
        self._process.terminate()
        self._process.wait()
        while self._pipes:
            os.close(self._pipes.pop())
