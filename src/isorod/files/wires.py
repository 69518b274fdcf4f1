"""Wires of STEP and IGES files, by the kernel of gmsh: points along them."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError

ENDINGS = (".step", ".stp", ".iges", ".igs")

# Points along each edge: circles of less than a whole turn bend by less between two than a corner does.
_POINTS = 193

# Ends nearer to each other than this fraction of the wire's size are joined.
_SAME = 1e-7


@contextmanager
def gmsh_session() -> Iterator[ModuleType]:
    """Start gmsh silently with an empty model, and end it again.

    Raises
    ------
    InputError
        If it is not installed.
    """
    interrupt = signal.getsignal(signal.SIGINT)
    try:
        import gmsh
    except ImportError:
        raise InputError("gmsh is not installed; pip install gmsh, or Debian: apt install python3-gmsh") from None

    gmsh.initialize(["gmsh"], False)
    # Its import has taken Ctrl-C away.
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, interrupt)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.model.add("isorod")
        yield gmsh
    finally:
        gmsh.finalize()


def edges(path: Path) -> tuple[Array, list[list[int]]]:
    """Return points along the edges of a file, ``(m, 3)``, and the numbers of each edge's; ends that meet are one.

    Raises
    ------
    InputError
        If gmsh is not installed or cannot read it, or what is in it is not curves alone.
    """
    with gmsh_session() as gmsh:
        try:
            with _silent():
                found = gmsh.model.occ.importShapes(str(path), False)
            gmsh.model.occ.synchronize()
        except Exception as problem:
            raise InputError(f"gmsh cannot read it ({str(problem).strip():.80})") from None
        if any(dimension > 1 for dimension, _ in found):
            raise InputError("surfaces or volumes are in it, need a wire: curves alone, the rod's centre line")
        several = []
        for _, tag in gmsh.model.getEntities(1):
            (low,), (high,) = gmsh.model.getParametrizationBounds(1, tag)
            several.append(np.reshape(gmsh.model.getValue(1, tag, np.linspace(low, high, _POINTS)), (-1, 3)))
    if not several:
        raise InputError("no curves are in it")
    return _numbered(np.array(several))


@contextmanager
def _silent() -> Iterator[None]:
    """Suppress output: the kernel prints notes on IGES files from C++ to standard output, where records go."""
    sys.stdout.flush()
    kept = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def _numbered(several: Array) -> tuple[Array, list[list[int]]]:
    """Return points of edges ``(edges, points, 3)`` in a row, and each edge's numbers, an end's that of the first."""
    count = several.shape[1]
    points = several.reshape(-1, 3)
    numbers = np.arange(len(points)).reshape(-1, count)
    ends = numbers[:, [0, -1]].ravel()
    near = np.linalg.norm(points[ends][:, None] - points[ends], axis=2) <= _SAME * np.ptp(points, axis=0).max()
    numbers[:, [0, -1]] = ends[np.argmax(near, axis=1)].reshape(-1, 2)
    return points, numbers.tolist()
