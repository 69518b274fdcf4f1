"""Numba's cache of compiled functions: read fast, also where it cannot be written to, and by one process at a time."""

import fcntl
import os
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from typing import Any

from llvmlite import binding
from numba.core import environment
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.runtime import nrt


class Cache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of a function, whose files may be unreadable, damaged or on a full disk: then it is compiled."""

    # The file that is locked while it is this process that compiles the function.
    _lock: int | None = None

    def index(self) -> Any:
        """Return what is there, by signature and processor."""
        with suppress(Exception):
            return self._cache_file._load_index()
        return {}

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what is there for a signature, or None.

        Numba's own would first load all that it can compile, which takes longer than everything else at start.  Where
        there is none, other processes wait until it is compiled here, or it is waited for.
        """
        found = self._kept(sig, target_context)
        if found is None and self._claim():
            found = self._kept(sig, target_context)
        return found

    def _claim(self) -> bool:
        """Wait until no other process compiles the function, if that can be known, and let none do so until `give_up`.

        Locks end with their process, so that none is left behind.
        """
        with suppress(OSError):
            self._lock = _lock_file(str(self.cache_path))
            fcntl.lockf(self._lock, fcntl.LOCK_EX, 1, self._byte)
            return True
        return False

    def give_up(self) -> None:
        """Let other processes compile the function, if it is this one's turn."""
        if self._lock is not None:
            with suppress(OSError):
                fcntl.lockf(self._lock, fcntl.LOCK_UN, 1, self._byte)
            self._lock = None

    @property
    def _byte(self) -> int:
        """Which byte of the folder's lock is the function's."""
        return zlib.crc32(f"{self._py_func.__module__}.{self._py_func.__qualname__}".encode())

    def _kept(self, sig: Any, target_context: Any) -> Any:
        with suppress(Exception), self._guard_against_spurious_io_errors():
            _provide_memory(target_context)
            with _numba_at_rest(target_context.codegen()._engine):
                return self._load_overload(sig, target_context)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep it if that can be, in the place of what is damaged."""
        with suppress(OSError):
            try:
                super().save_overload(sig, data)
            # Reading damaged pickles raises anything.
            except Exception:
                self.flush()
                super().save_overload(sig, data)


@cache
def _lock_file(folder: str) -> int:
    """Return a file of a folder that stays open: to close it ends all locks on it."""
    os.makedirs(folder, exist_ok=True)
    return os.open(os.path.join(folder, "isorod.lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)


@cache
def _provide_memory(target_context: Any) -> None:
    """Let kept code find Numba's own functions for memory, without compiling what code yet to be compiled needs."""
    helpers = getattr(getattr(nrt, "_nrt", None), "c_helpers", None)
    if helpers is None:
        target_context.refresh()
        return
    for name, address in helpers.items():
        binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


class _Unread:
    """A module of kept code, of which what others would compile into theirs is read only when they do."""

    # What Numba would look for symbols in.
    functions = global_variables = ()

    def __init__(self, code: bytes) -> None:
        self._code = code

    def names(self, symbol: str) -> bool:
        """Return whether a symbol is named in it: the names stand there as they are."""
        return symbol.encode() in self._code

    def clone(self) -> Any:
        """Return the module itself, to be linked into another one."""
        return _PARSE(self._code)

    def as_bitcode(self) -> bytes:
        """Return what it is read from."""
        return self._code


_PARSE = binding.parse_bitcode


class _Symbols(set[str]):
    """Symbols that are known, and those named in modules that have not been read."""

    def __init__(self, known: set[str]) -> None:
        super().__init__(known)
        self.unread: list[_Unread] = []

    def __contains__(self, symbol: object) -> bool:
        if super().__contains__(symbol):
            return True
        # Asked for are those of what was read last, and some again and again.
        found = any(one.names(str(symbol)) for one in reversed(self.unread))
        if found:
            self.add(str(symbol))
        return found


@contextmanager
def _numba_at_rest(engine: Any) -> Iterator[None]:
    """Read kept code, but neither Numba's modules that some of it was compiled from nor what is there to be compiled.

    Code that is compiled asks nothing of them, and they take longer than all else that is read.
    """
    rebuild, symbols = environment._rebuild_env, engine._defined_symbols
    if not isinstance(symbols, _Symbols):
        symbols = engine._defined_symbols = _Symbols(symbols)

    def light(module: str, constants: list[Any], name: str) -> Any:
        if module in sys.modules or not module.startswith("numba."):
            return rebuild(module, constants, name)
        found = environment.lookup_environment(name)
        if found is None:
            found = environment.Environment({"__name__": module})
            found.consts[:] = constants
            found.env_name = name
            environment.Environment._memo[name] = found
        return found

    def later(code: bytes, _: Any = None) -> _Unread:
        symbols.unread.append(_Unread(code))
        return symbols.unread[-1]

    environment._rebuild_env, binding.parse_bitcode = light, later
    try:
        yield
    finally:
        environment._rebuild_env, binding.parse_bitcode = rebuild, _PARSE


def beside(function: Any) -> str:
    """Return the folder beside the source of a function in which its code may be kept."""
    return os.path.join(os.path.dirname(function.__code__.co_filename), "__pycache__")


# Its name differs between versions of Numba.
_InTree: Any = next(one for one in CompileResultCacheImpl._locator_classes if "InTree" in one.__name__)


class _ReadOnlyLocator(_InTree):
    """The folder beside the source, whether it can be written to or not."""

    def ensure_cache_path(self) -> None:
        if not os.path.isdir(self.get_cache_path()):
            raise OSError


class _ReadOnlyImpl(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes: Any = (_ReadOnlyLocator,)


class ReadOnlyCache(Cache):
    """The same beside the source, where that can be read and not written to."""

    _impl_class: Any = _ReadOnlyImpl
