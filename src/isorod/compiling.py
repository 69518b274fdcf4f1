"""When functions are compiled: when they are first called, by Numba, which keeps them (`isorod.keeping`)."""

import atexit
import functools
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numba
from numba.core import event
from numba.extending import typeof_impl

from isorod import keeping

# All functions with a signature, in the order in which their modules were imported.
KERNELS: list["Kernel"] = []

_PACKAGE = Path(__file__).parent

# What takes longest, and is needed last: elements' tangents and forces, and what they are made of; the band solver.
_LONGEST = tuple(
    f"isorod.{name}"
    for name in ("assembly.stiffness_kernel", "assembly.field_kernel", "assembly.block_kernel", "petsc.band_kernel")
)

# Number of modules to compile from which a second process takes part.
_MANY = 5


class Kernel:
    """A function of `njit`: compiled, or read from the disk, when it is first called from Python or compiled code.

    Attributes
    ----------
    py_func
        The function itself.
    declared
        The one signature it is compiled for; None if for any that compiled code calls it with.
    """

    def __init__(self, function: Callable[..., Any], declared: Any, options: dict[str, Any]) -> None:
        self.py_func, self.declared, self._options = function, declared, options
        functools.update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        return self.compiled(*arguments)

    @functools.cached_property
    def compiled(self) -> Any:
        """Numba's dispatcher, compiled for the declared signature."""
        with keeping.cache_in(self._folder, self._name):
            # Reading damaged files raises anything: they are removed, and are not replaced if that cannot be.
            for cached in (True, True, False):
                try:
                    return numba.njit(self.declared, cache=cached, **self._options)(self.py_func)
                except Exception:
                    if not cached:
                        raise
                    for file in self._files():
                        with suppress(OSError):
                            file.unlink()

    @property
    def kept(self) -> bool:
        """Whether the code of the declared signature is on the disk, and of the present source."""
        return bool(self._files())

    @property
    def _folder(self) -> Path:
        return keeping.folder(self.py_func.__code__.co_filename)

    @property
    def _name(self) -> str:
        return f"{Path(self.py_func.__code__.co_filename).stem}.{self.py_func.__qualname__}"

    def _files(self) -> list[Path]:
        return [*self._folder.glob(f"*/{self._name}-*.nb?")]


@typeof_impl.register(Kernel)
def _type(kernel: Kernel, _: Any) -> Any:
    """Return the type of a kernel in compiled code that calls it: that of Numba's dispatcher."""
    return numba.typeof(kernel.compiled)


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
        kernel = Kernel(function, signature, {"boundscheck": None, "forceinline": True} | options)
        if signature is not None:
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
    if len(os.sched_getaffinity(0)) < 2 or rank() or not keeping.lasting():
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


class Notice(event.Listener):  # type: ignore[misc]
    """Prints one line on standard error when the first function is compiled, and starts a second process.

    Attributes
    ----------
    reported
        Whether it was printed.
    shares
        Whether a second process compiles too (`share`).
    time
        How long it takes, in words.
    """

    reported = shares = False
    time = "some 10 seconds"

    def on_start(self, compilation: Any) -> None:
        """Print the line."""
        # Functions of scripts that another runs may be of no module.
        if self.reported or not (compilation.data["dispatcher"].py_func.__module__ or "").startswith("isorod"):
            return
        self.reported = True
        if rank():
            return
        print(f"isorod: compiling ({self._how()})", file=sys.stderr, flush=True)
        if self.shares:
            share()

    def on_end(self, compilation: Any) -> None:
        """Do nothing."""

    def _how(self) -> str:
        if keeping.lasting():
            return f"once, {self.time}; kept in {keeping.room()}"
        return f"{self.time}, each time: {HINT}"


HINT = "no folder to keep it in can be written to; set NUMBA_CACHE_DIR to one that can"

NOTICE = Notice()
event.register("numba:compile", NOTICE)
