"""The command line, split once: ``--long`` options are ours, ``-single`` ones go to PETSc untouched."""

import argparse
import dataclasses
import difflib
import os
import re
import sys
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from itertools import pairwise
from typing import Any, NoReturn

from isorod.errors import InputError


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line (`InputError`)."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        # argparse itself takes -1e-3 for an option.
        self._negative_number_matcher = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")

    def error(self, message: str) -> NoReturn:
        """Raise `InputError`."""
        raise InputError(f"{message} (see {self.prog} --help)")

    def known(self, arguments: Sequence[str]) -> argparse.Namespace:
        """Parse, and name what is not known together with the nearest option there is."""
        for word in arguments:
            # argparse itself makes an empty list of this value.
            if word.startswith("--") and word.endswith("=--"):
                self.error(f"argument {word[:-3]}: expected one argument")
        found, unknown = self.parse_known_args(arguments)
        if unknown:
            word = unknown[0].split("=")[0]
            names = [name for action in self._actions for name in action.option_strings]
            near = difflib.get_close_matches(word, names, 1)
            self.error(f"option {word} is not known" + (f"; did you mean {near[0]}?" if near else ""))
        return found


def add_fields(parser: argparse.ArgumentParser, scene_type: Any) -> None:
    """Make each field of a scene a ``--long-option``; one that is true or false (false where not given) takes no value."""
    for field in dataclasses.fields(scene_type):
        kind: Any = field.type
        if isinstance(kind, types.UnionType):
            kind = typing.get_args(kind)[0]
        shown = field.metadata["help"] + ("" if field.default is None else f" ({field.default})")
        flag = "--" + field.name.replace("_", "-")
        if kind is bool:
            parser.add_argument(flag, dest=field.name, action="store_true", help=field.metadata["help"])
            continue
        parser.add_argument(flag, dest=field.name, type=kind, default=field.default, metavar=kind.__name__, help=shown)


def fields(found: argparse.Namespace, scene_type: Any) -> dict[str, Any]:
    """Return a scene's fields as parsed."""
    return {field.name: getattr(found, field.name) for field in dataclasses.fields(scene_type)}


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
        if kind is None or not isinstance(problem, kind):
            raise
        lines = [re.sub(r"^\[\d+\] ", "", text).strip() for text in str(problem).splitlines()]
        said = [text for text in lines if text and not re.match(r"error code|\w+\(\) (line|at)", text)]
        raise InputError(f"PETSc: {' '.join(said) or lines[0]} (see -help)") from None


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
