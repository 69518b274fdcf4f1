"""PETSc's options as a mapping, in force for one analysis."""

import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from numbers import Real

from petsc4py import PETSc

from isorod.errors import InputError
from isorod.options import AT_THE_START, petsc_errors
from isorod.petsc.library import is_used


@contextmanager
def in_force(values: Mapping[str, object] | None) -> Iterator[None]:
    """Set options within the context, over those typed, and restore the former ones after it.

    A warning, not an error, names those that were not used: a misspelling must not cost a result that took hours.

    Parameters
    ----------
    values
        Values by name, as in ``{"snes_rtol": 1e-10, "snes_monitor": None}``: numbers, texts, lists of them, True,
        False, or None for an option that stands without a value.

    Raises
    ------
    InputError
        If a name or a value cannot be one, PETSc reads the option only when it starts, or refuses it.
    """
    words = {} if values is None else _words(values)
    if not words:
        yield
        return
    options = PETSc.Options()
    before = {name: options.getString(name) for name in words if options.hasName(name)}
    try:
        for name, word in words.items():
            # Deleted first: the former one may be marked as used.
            options.delValue(name)
            options.setValue(name, word)
        with petsc_errors():
            yield
        left = [name for name in words if not is_used(name)]
    finally:
        for name in words:
            options.delValue(name)
        for name, word in before.items():
            options.setValue(name, word or None)
    if left:
        # Points to the caller of the function with this context.
        warnings.warn(f"PETSc option {', '.join(left)}: nothing used it; check its spelling", stacklevel=4)


def _words(values: Mapping[str, object]) -> dict[str, str | None]:
    """Return options as PETSc reads them."""
    if not isinstance(values, Mapping):
        raise InputError(f'petsc: got {type(values).__name__}, need a mapping such as {{"snes_rtol": 1e-10}}')
    words: dict[str, str | None] = {}
    for name, value in values.items():
        if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z]\w*", name):
            raise InputError(f"PETSc option {name!r}: need a name without a dash, such as 'snes_rtol'")
        if AT_THE_START.match(f"-{name}"):
            raise InputError(
                f"PETSc option {name}: PETSc reads it only when it starts; give it to isorod.options.initialize before "
                "anything imports petsc4py.PETSc"
            )
        several = value if isinstance(value, list | tuple) else [value]
        if value is not None and not all(isinstance(one, str | Real) for one in several):
            raise InputError(f"PETSc option {name}: got {type(value).__name__}, need a number, a text, True or None")
        words[name] = None if value is None else ",".join(str(one) for one in several)
    return words
