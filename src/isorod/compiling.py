"""When functions are compiled, and where what they are compiled to is kept.

Numba keeps it in the folder ``NUMBA_CACHE_DIR`` if that is set, else beside the source, else, where that cannot be
written to, in the user's folder for such things.  Here it may also be read beside the source without being written
there, as where an administrator has installed and compiled everything, and where nothing can be written nothing is
kept.
"""

import atexit
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from numba import config
from numba.core import event
from numba.core.registry import CPUDispatcher

from isorod.keeping import Cache, ReadOnlyCache, beside

# Numba's own, whose types are known at run time alone.
_Dispatcher: Any = CPUDispatcher

# All functions with a signature, in the order in which their modules were imported.
KERNELS: list["Kernel"] = []

_PACKAGE = Path(__file__).parent

# What takes longest, and is needed last: elements' tangents and forces, and what they are made of; the band solver.
_LONGEST = tuple(
    f"isorod.{name}"
    for name in ("assembly.stiffness_kernel", "assembly.field_kernel", "assembly.block_kernel", "petsc.band_kernel")
)

# Modules with something to compile from which on it is shared with another process.
_MANY = 5


class Kernel(_Dispatcher):
    """A function of `njit`: compiled, or read from the disk, when it is first called from Python or compiled code.

    Attributes
    ----------
    declared
        The one signature it is compiled for; None if for any it is called with.
    """

    declared: Any = None

    def ready(self) -> None:
        """Have it compiled for the declared signature."""
        if self.declared is not None and self._can_compile:
            self.compile(self.declared)
            self.disable_compile()

    @property
    def kept(self) -> bool:
        """Whether the code of the declared signature is on the disk, and of the present source."""
        cache = self._find_cache()
        if cache is None:
            return False
        key = cache._index_key(self.declared, self.targetctx.codegen())
        return key in cache.index()

    @property
    def folder(self) -> str | None:
        """Where its code is kept, or None."""
        cache = self._find_cache()
        return None if cache is None else str(cache.cache_path)

    @property
    def lasting(self) -> bool:
        """Whether what is compiled now can be kept."""
        cache = self._find_cache()
        return cache is not None and os.access(cache.cache_path, os.W_OK)

    def compile(self, sig: Any) -> Any:
        """Compile for a signature, or read what was compiled before."""
        cache = self._find_cache()
        if cache is None:
            return super().compile(sig)
        self._cache = cache
        try:
            return super().compile(sig)
        finally:
            cache.give_up()

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return what a call in compiled code is compiled to."""
        self.ready()
        return super().get_call_template(args, kws)

    def _compile_for_args(self, *args: Any, **kws: Any) -> Any:
        if self.declared is None:
            return super()._compile_for_args(*args, **kws)
        # What is returned is called with the arguments, and no longer compiles but converts or refuses them.
        self.ready()
        return self

    def _find_cache(self) -> Cache | None:
        """Return the cache that Numba would write to, but that beside the source where that alone has the code."""
        if isinstance(self._cache, Cache):
            return self._cache
        found = None
        for kind in (Cache, ReadOnlyCache):
            # Without a folder to write to, or to read from, there is none of the kind.
            with suppress(RuntimeError):
                cache = kind(self.py_func)
                if found is None or (cache.index() and not found.index()):
                    found = cache
            if found is not None and (config.CACHE_DIR or found.cache_path == beside(self.py_func)):
                break
        return found


def njit(signature: Any = None, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorate a function as `numba.njit` does, but compile it when it is first called, and keep it where that can be.

    What Python calls has a signature: then `isorod compile` knows it.  ``options`` are those of `numba.njit`.  It
    returns no named tuple: Numba makes one by code in Python, in which an interrupt raises its exception, and then
    calls what it has not got.

    All that compiled code calls is inlined.  Else a function would be there several times, differently optimised, by
    itself and in each that calls it, and which copy is run would be a matter of what was compiled or read first: a
    process that compiles would have other last bits than one that reads what is kept.
    """

    def decorate(function: Callable[..., Any]) -> Kernel:
        kernel = Kernel(function, targetoptions={"nopython": True, "boundscheck": None, "forceinline": True} | options)
        if signature is not None:
            kernel.declared = signature
            KERNELS.append(kernel)
        return kernel

    return decorate


def load_all() -> list[Kernel]:
    """Import each module that has functions to compile; return those with a signature."""
    for file in sorted(_PACKAGE.rglob("*.py")):
        if "njit(" in file.read_text(encoding="utf-8"):
            import_module(".".join(["isorod", *file.relative_to(_PACKAGE).with_suffix("").parts]))
    return KERNELS


def share() -> subprocess.Popen[bytes] | None:
    """Let another process compile what the modules imported so far have and is not kept, the last first; return it.

    Compiling is one thread's work, and this process begins with what it needs first.  What takes longest it needs last,
    so the other one begins with that.  None where there is little to compile, one processor, or nothing can be kept.
    It is ended when this process ends.
    """
    if len(os.sched_getaffinity(0)) < 2 or rank() or not KERNELS or not KERNELS[0].lasting:
        return None
    # Those of laws that are made from energies no other process can import by their names.
    names = (kernel.py_func.__module__ for kernel in reversed(KERNELS) if not kernel.kept)
    modules = dict.fromkeys(name for name in names if name.startswith("isorod."))
    if len(modules) < _MANY:
        return None
    ordered = [*(name for name in _LONGEST if name in modules), *(name for name in modules if name not in _LONGEST)]
    nothing: Any = {name: subprocess.DEVNULL for name in ("stdin", "stdout", "stderr")}
    other = subprocess.Popen([sys.executable, "-m", "isorod.command.compile", *ordered], **nothing)
    atexit.register(other.terminate)
    return other


def rank() -> int:
    """Return this process's number among those of MPI, before that is started."""
    return int(os.environ.get("OMPI_COMM_WORLD_RANK", os.environ.get("PMI_RANK", "0")))


def place(kernel: Kernel) -> str:
    """Return where compiled code is kept, in words: the package's folders or the one round all of them."""
    folder = kernel.folder
    if folder is None:
        return ""
    return f"{_PACKAGE}/**/__pycache__" if folder == beside(kernel.py_func) else os.path.dirname(folder)


class Notice(event.Listener):  # type: ignore[misc]
    """Says in one line on standard error that something is compiled, when that is first so, and has it shared.

    Attributes
    ----------
    said
        Whether it was said.
    shares
        Whether another process is to compile too (`share`): what there is to compile is looked for then alone.
    time
        How long it takes, in words.
    """

    said = shares = False
    time = "some 10 seconds"

    def on_start(self, found: Any) -> None:
        """Say it."""
        kernel = found.data["dispatcher"]
        if self.said or not isinstance(kernel, Kernel):
            return
        self.said = True
        if rank():
            return
        print(f"isorod: compiling ({self._how(kernel)})", file=sys.stderr, flush=True)
        if self.shares:
            share()

    def on_end(self, found: Any) -> None:
        """Say nothing."""

    def _how(self, kernel: Kernel) -> str:
        if kernel.lasting:
            return f"once, {self.time}; kept in {place(kernel)}"
        return f"{self.time}, each time: {HINT}"


HINT = "no folder to keep it in can be written to; set NUMBA_CACHE_DIR to one that can"

NOTICE = Notice()
event.register("numba:compile", NOTICE)
