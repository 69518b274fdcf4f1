"""Warnings of a command: kept until there is a result (an error is printed alone), except deprecations."""

import sys
import warnings
from collections.abc import Callable

_NOTES: list[str] = []

# Puts a file's own names in the place of numbers.
_NAMED: list[Callable[[str], str]] = []


def keep() -> None:
    """Keep warnings from now on, none so far."""
    warnings.showwarning = _keep
    _NOTES.clear()
    _NAMED.clear()


def name(named: Callable[[str], str]) -> None:
    """Use the names of a scene in the warnings."""
    _NAMED.append(named)


def show() -> None:
    """Print the warnings, a line each."""
    for text in _NOTES:
        for named in _NAMED:
            text = named(text)
        print(f"isorod: warning: {text}", file=sys.stderr)


def _keep(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
    _NOTES.append(" ".join(str(message).split()))
    if issubclass(category, FutureWarning):
        # What was misread may be why there is no result.
        show()
        _NOTES.clear()
