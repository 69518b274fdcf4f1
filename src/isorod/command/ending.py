"""How a command ends: whatever stops it, one line on standard error and an exit code.

0 for success, 2 for an error of the user's or a full disk behind standard output, 130 for Ctrl-C (SIGINT), 143 for
SIGTERM.  A second signal ends at once.
"""

import ctypes
import errno
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from isorod import memory
from isorod.errors import InputError, SolveError

# Environment variables that MPI launchers set before MPI starts: the rank's number, and the number of ranks.
_RANK = "OMPI_COMM_WORLD_RANK", "PMI_RANK"
_SIZE = "OMPI_COMM_WORLD_SIZE", "PMI_SIZE"

_WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "ended by SIGTERM"}

# A file that takes no more: full, over its quota or the largest size, or its device fails.
_FULL = errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO

# Seconds that other ranks wait before they end with an error: launchers end all at the first that does, and rank 0 may
# not have printed it yet.  Where it has, Open MPI ends them at once; MPICH's may wait until they end.
_PATIENCE = 3.0

# Longer words of an error are cut: they come from wrong input.
_LONGEST = 1000


class Terminated(KeyboardInterrupt):
    """SIGTERM: unwinds as Ctrl-C does."""


def run(program: str, command: Callable[[], int], kept: str = "", at_once: bool = False) -> int:
    """Run a command and return its exit code, having printed in one line what stopped it.

    Parameters
    ----------
    program
        Name that the line begins with.
    command
        What to run; returns an exit code.
    kept
        Message when a signal ends it; notes of the exception follow.
    at_once
        End in a signal at once, also within long calls of compiled libraries, and clean up nothing.  So it is always on
        several ranks: one that unwinds would wait for others that wait for it.
    """
    at_once = at_once or _launched()
    with _signals(program, kept, at_once) as came:
        try:
            try:
                return command()
            finally:
                # Here a full disk can still be reported in one line, unlike at Python's own exit.
                if sys.stdout is not None:
                    sys.stdout.flush()
        except BaseException as problem:
            if isinstance(problem, KeyboardInterrupt) and not came:
                came.append(signal.SIGINT)
            # Libraries make errors of their own of what unwinds through them.
            if came:
                return _stop(program, came[0], kept, *getattr(problem, "__notes__", []))
            return _refuse(program, problem)


def _refuse(program: str, problem: BaseException) -> int:
    """Print the error and return the exit code; raise again an error of the program itself."""
    match problem:
        case InputError() | SolveError():
            return fail(program, str(problem))
        case MemoryError():
            return fail(program, str(problem) or memory.SHORT)
        case BrokenPipeError():
            _discard_output()
            return 1
        case OSError(filename=None) if problem.errno in _FULL:
            _discard_output()
            return fail(program, f"standard output: cannot be written ({problem.strerror})")
    raise problem


def _stop(program: str, number: int, *kept: str) -> int:
    """Print which signal came and what is kept; return the exit code."""
    if rank() == 0:
        _print_error(program, "; ".join([_WORDS[signal.Signals(number)], *filter(None, kept)]))
    return 128 + number


def fail(program: str, message: str) -> int:
    """Print an error, once for all ranks; return the exit code."""
    if rank() == 0:
        _print_error(program, message)
    elif _launched():
        time.sleep(_PATIENCE)
    return 2


def announce(words: str) -> None:
    """Print a notice on standard error, once for all ranks."""
    if rank() == 0:
        print(f"isorod: {words}", file=sys.stderr, flush=True)


def rank() -> int:
    """Return the number of this rank, also before MPI has started."""
    number = next((os.environ[name] for name in _RANK if name in os.environ), None)
    world = getattr(sys.modules.get("petsc4py.PETSc"), "COMM_WORLD", None)
    return int(number or (world.getRank() if world else 0))


def _launched() -> bool:
    """Return whether this is one of several ranks."""
    return any(int(os.environ.get(name, "1")) > 1 for name in _SIZE)


@contextmanager
def _signals(program: str, kept: str, at_once: bool) -> Iterator[list[int]]:
    """Let SIGINT and SIGTERM unwind the stack or, at once, end the process; yield which has come, if one has.

    Signals that the caller ignores stay ignored.
    """
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield came
        return
    numbers = [number for number in _WORDS if signal.getsignal(number) is not signal.SIG_IGN]

    def unwind(number: int, frame: FrameType | None) -> None:
        for one in numbers:
            signal.signal(one, signal.SIG_DFL)
        came.append(number)
        if _importing(frame):
            os._exit(_stop(program, number, kept))
        raise Terminated if number == signal.SIGTERM else KeyboardInterrupt

    wakeup = _watch(program, kept) if at_once else None
    before = {number: signal.signal(number, (lambda *_: None) if at_once else unwind) for number in numbers}
    try:
        yield came
    finally:
        if wakeup is not None:
            os.close(signal.set_wakeup_fd(wakeup))
        for number, handler in before.items() if not came else ():
            signal.signal(number, handler)


def _importing(frame: FrameType | None) -> bool:
    """Return whether a module is being loaded, which may take an exception for a sign that it is not there."""
    while frame is not None and frame.f_code.co_name != "_find_and_load":
        frame = frame.f_back
    return frame is not None


def _watch(program: str, kept: str) -> int:
    """Start a thread that ends the process when a signal comes; return the descriptor that was woken before.

    Python's own handlers would wait for the library call that the main thread is in.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)

    def wait() -> None:
        while number := os.read(reading, 1):
            if number[0] in _WORDS:
                code = _stop(program, number[0], kept)
                if _launched():
                    _die(number[0])
                os._exit(code)
        os.close(reading)

    threading.Thread(target=wait, daemon=True).start()
    return signal.set_wakeup_fd(writing)


def _die(number: int) -> None:
    """End by the signal itself: MPICH's launcher may leave the other ranks when one exits with a code."""
    # Python sets handlers in its main thread only, which may be in a long call.
    ctypes.CDLL(None).signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)
    time.sleep(1.0)


def _print_error(program: str, message: str) -> None:
    # Quoted input may have line ends or any length; standard error may be closed.
    text = " ".join(word if len(word) <= _LONGEST else f"{word[: _LONGEST // 2]}..." for word in message.split())
    with suppress(OSError):
        print(f"{program}: {text}", file=sys.stderr, flush=True)


def _discard_output() -> None:
    """Let go what standard output still holds: Python would try once more at its end."""
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
