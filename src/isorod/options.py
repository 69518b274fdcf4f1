"""The command line, split once: ``--long`` options are ours, ``-single`` ones go to PETSc untouched."""

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager


def split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return our arguments and PETSc's.

    A PETSc option is a single dash and a letter; the word behind it is its value unless that starts an option itself (a
    negative number does not).
    """
    ours: list[str] = []
    theirs: list[str] = []
    k = 0
    while k < len(arguments):
        word = arguments[k]
        k += 1
        if not re.match(r"-[A-Za-z]", word) or word == "-h":
            ours.append(word)
            continue
        theirs.append(word)
        if k < len(arguments) and not re.match(r"-{1,2}[A-Za-z]", arguments[k]):
            theirs.append(arguments[k])
            k += 1
    return ours, theirs


def initialize(arguments: Sequence[str]) -> None:
    """Start PETSc with its part of the command line; must come before anything else imports ``petsc4py.PETSc``."""
    import petsc4py

    petsc4py.init([sys.argv[0], *arguments])


@contextmanager
def defaults(values: Mapping[str, object]) -> Iterator[set[str]]:
    """Offer options to the objects configured within, except those the user has typed; yields the names typed."""
    from petsc4py import PETSc

    options = PETSc.Options()
    typed = {name for name in (*values, "snes_atol") if options.hasName(name)}
    added = [name for name in values if name not in typed]
    for name in added:
        options[name] = values[name]
    try:
        yield typed
    finally:
        for name in added:
            options.delValue(name)
