"""Compiling everything ahead, so that no run has to wait for it: the command ``isorod compile``."""

import sys
from collections.abc import Sequence
from importlib import import_module
from time import perf_counter

from isorod.errors import InputError


def main() -> int:
    """Compile what is not cached yet, and print number, place and time in one line; return the exit code.

    Raises
    ------
    InputError
        If it could not be kept, before anything is compiled.
    """
    from isorod import compiling, keeping

    start = perf_counter()
    kernels = compiling.load_all()
    if not keeping.lasting():
        raise InputError(f"compile: {compiling.HINT}")
    _make_laws()
    missing = [kernel for kernel in kernels if not kernel.kept]
    compiling.NOTICE.time = "about a minute"
    other = compiling.share()
    for kernel in missing:
        # The other process comes from the end.
        if not kernel.kept:
            _ = kernel.compiled
    if other is not None:
        other.wait()
    seconds = perf_counter() - start
    there = len(kernels) - len(missing)
    print(
        f"isorod: {len(missing)} functions compiled in {seconds:.0f} s, {there} cached before; kept in {keeping.room()}"
    )
    return 0


def _make_laws() -> None:
    """Make the functions of laws that have one energy whatever their constants, for `isorod.compiling.KERNELS`."""
    from isorod.files.schema import LAWS
    from isorod.material.written import named

    for form in LAWS.values():
        recipe = getattr(form.function, "recipe", None)
        if isinstance(recipe, tuple):
            named(*recipe)


def _quietly(modules: Sequence[str]) -> int:
    """Compile the functions of modules that are not cached, beside a running process (`isorod.compiling.share`)."""
    from isorod import compiling

    compiling.NOTICE.reported = True
    for name in modules:
        import_module(name)
        for kernel in reversed(compiling.KERNELS):
            if kernel.py_func.__module__ == name and not kernel.kept:
                _ = kernel.compiled
    return 0


if __name__ == "__main__":
    try:
        sys.exit(_quietly(sys.argv[1:]) if len(sys.argv) > 1 else main())
    except InputError as problem:
        print(f"isorod: {problem}", file=sys.stderr)
        sys.exit(2)
