"""How much memory there is, asked before it is taken: the system ends a program that takes more, without a word."""

import os
import resource
from contextlib import suppress
from pathlib import Path

from isorod.errors import InputError

_GIGABYTE = 1e9

_CURE = "take fewer elements, section or quadrature points"
SHORT = f"not enough memory for this; {_CURE}"

# Address space without which the libraries do not load: some end in a traceback then, OpenBLAS tries for ever.
_LEAST = 1e9

# Bytes that the libraries leave free at any rate; asking takes longer than a small solve may.
SMALL = 16e6


def refuse_little() -> None:
    """Raise `InputError` if the user's limit leaves no room for the libraries."""
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    if soft != resource.RLIM_INFINITY and soft < _LEAST:
        raise InputError(f"memory is limited to {soft / _GIGABYTE:.3g} GB ('ulimit -v'); isorod needs 1 GB at least")


def available() -> float:
    """Return how many bytes this process may still take: what the system has free, and what the user's limit leaves."""
    left = float(os.sysconf("SC_PHYS_PAGES") * resource.getpagesize())
    used = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Not every system has these, nor every container.
    with suppress(OSError, KeyError, ValueError):
        known = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
        left = 1024.0 * float(known["MemAvailable"].split()[0])
        used = float(int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize())
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return left if soft == resource.RLIM_INFINITY else min(left, soft - used)


def ask(size: float, what: str) -> None:
    """Raise `InputError` if there are not so many bytes for something that is not small."""
    if size <= SMALL:
        return
    left = available()
    if size > left:
        raise InputError(f"{what} needs about {size / _GIGABYTE:.3g} GB, {left / _GIGABYTE:.3g} GB are free; {_CURE}")
