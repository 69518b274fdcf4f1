"""PETSc's options: those the user has typed, and those offered beside them."""

import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from itertools import pairwise
from typing import Any

from isorod.errors import InputError


def initialize(arguments: Sequence[str]) -> None:
    """Start PETSc with its part of the command line; must come before anything else imports ``petsc4py.PETSc``."""
    import petsc4py

    if any(option.startswith(("-eps_", "-st_", "-slepc", "-bv_", "-ds_")) for option in arguments):
        start: Any = import_module("slepc4py")
    else:
        start = petsc4py
    for option, value in pairwise(arguments):
        # PETSc itself prints a page about this.
        if option == "-options_file" and not os.access(value, os.R_OK):
            raise InputError(f"PETSc options file {value}: cannot be read")
    # A fixed name: PETSc takes the program's for an option if it looks like one.
    # Its signal handler would answer a closed pipe with a page of text.
    start.init(["isorod", "-no_signal_handler", *arguments])


@contextmanager
def petsc_errors() -> Iterator[None]:
    """Turn errors that PETSc raises, such as an unknown solver type, into one-line `InputError`."""
    try:
        yield
    except Exception as problem:
        petsc = sys.modules.get("petsc4py.PETSc")
        kind = getattr(petsc, "Error", None) if petsc else None
        # Some builds of slepc4py return beside raising, of which Python makes an error of its own.
        told = problem.__cause__ if isinstance(problem, SystemError) else problem
        if kind is None or not isinstance(told, kind):
            raise
        lines = [re.sub(r"^\[\d+\] ", "", text).strip() for text in str(told).splitlines()]
        said = [text for text in lines if text and not re.match(r"error code|\w+\(\) (line|at)", text)]
        raise InputError(f"PETSc: {' '.join(said) or lines[0]} (see -help)") from None


@contextmanager
def defaults(values: Mapping[str, object]) -> Iterator[None]:
    """Offer options to the objects configured within, except those the user has typed."""
    from petsc4py import PETSc

    options = PETSc.Options()
    added = [name for name in values if not options.hasName(name)]
    for name in added:
        options[name] = values[name]
    try:
        yield
    finally:
        for name in added:
            options.delValue(name)
