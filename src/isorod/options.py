"""PETSc's options: those the user has typed, and those offered beside them."""

import os
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import IO, Any

from isorod.errors import InputError

# What PETSc reads only when it starts; all other options are read by what they are for.
AT_THE_START = re.compile(
    r"-(info\w*|log\w*|malloc\w*|debug\w*|start_in_debugger|stop_for_debugger|on_error_\w+|fp_trap|history|python|mpi\w*"
    r"|get_total_flops|check_pointer_intensity|device_\w+|cuda_\w+|hip_\w+|use_gpu_aware_mpi|options_monitor\w*"
    r"|no_signal_handler|skip_petscrc|petsc_\w+|display|nox\w*|saws_\w+|tmp|shared_tmp|not_shared_tmp|version|v)$"
)

# Variables set by launchers of several processes, and settings of Open MPI for a single process.
_LAUNCHED = ("OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK", "PMI_FD")
_ALONE = {"OMPI_MCA_ess_singleton_isolated": "1", "OMPI_MCA_pml": "ob1"}

# Variables with the rank of a process.
_RANKS = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")

# Options that PETSc reads further options from, or puts before the names of others.
_READ = re.compile(r"-(options_(file|string)\w*|prefix_(push|pop))$")

# PETSc's options for all of a person's programs.  Of a folder that somebody else may have filled it reads none: options
# name code that PETSc runs, and files that it writes.
_OWN = Path("~/.petscrc")


def initialize(arguments: Sequence[str]) -> None:
    """Give PETSc its part of the command line, and start it if it does not run yet.

    Files of options are those that are named, and ``~/.petscrc``; a line on stderr names them.  Nothing needs this to
    be called but options: importing what uses PETSc starts it.

    Raises
    ------
    InputError
        If PETSc runs already and an option is one that it reads only when it starts, or a file of options cannot be
        read; none of the options is set then.
    """
    import petsc4py

    for option, value in pairwise(arguments):
        # PETSc itself prints a page about this.
        if option == "-options_file" and not (os.path.isfile(value) and os.access(value, os.R_OK)):
            raise InputError(f"PETSc options file {value}: cannot be read")
    if arguments.count("-prefix_push") > arguments.count("-prefix_pop"):
        raise InputError("PETSc option -prefix_push: it stays for all others; end it with -prefix_pop")
    running: Any = sys.modules.get("petsc4py.PETSc")
    if running is not None and running.Sys.isInitialized():
        late = next((word for word in arguments if AT_THE_START.match(word)), None)
        if late is not None:
            raise InputError(
                f"PETSc option {late}: PETSc runs already and reads it only when it starts; call "
                "isorod.options.initialize before anything imports petsc4py.PETSc, as isorod's analyses and dolfinx do"
            )
        running.Options().insertString(" ".join(f'"{word}"' if " " in word else word for word in arguments))
        return
    if any(option.startswith(("-eps_", "-st_", "-slepc", "-bv_", "-ds_")) for option in arguments):
        start: Any = import_module("slepc4py")
    else:
        start = petsc4py
    own = _own_file()
    named = [value for option, value in pairwise(arguments) if option == "-options_file"]
    files = [*([str(own)] if own else []), *named]
    if files and next((os.environ[one] for one in _RANKS if one in os.environ), "0") == "0":
        print(f"isorod: PETSc options of {', '.join(files)}", file=sys.stderr)
    # A fixed name: PETSc takes the program's for an option if it looks like one.
    # Its signal handler would answer a closed pipe with a page of text.
    first = ["isorod", "-no_signal_handler", "-skip_petscrc", *(["-options_file", str(own)] if own else [])]
    with _alone(), _page_read() if own or any(map(_READ.match, arguments)) else nullcontext():
        start.init([*first, *arguments])


@contextmanager
def _page_read() -> Iterator[None]:
    """Make one line of the page that PETSc prints where it cannot read its options, for which it raises a number."""
    place, kept = tempfile.TemporaryFile(), os.dup(2)
    os.dup2(place.fileno(), 2)
    failed = True
    try:
        yield
        failed = False
    except Exception:
        os.dup2(kept, 2)
        raise InputError(f"PETSc options: {_first_message(_text(place))}") from None
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        if not failed:
            print(_text(place), end="", file=sys.stderr)
        place.close()


def _text(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode(errors="replace")


def _first_message(page: str) -> str:
    """Return the part of a PETSc error message before versions and options."""
    lines = [re.sub(r"^\[\d+\]PETSC ERROR: ", "", one).strip() for one in page.splitlines()]
    messages = [one for one in lines if one and not one.startswith("---")]
    upto = next((k for k, one in enumerate(messages) if re.match(r"WARNING!|Option left|See http", one)), len(messages))
    plain = "".join(letter if letter.isprintable() else "?" for letter in " ".join(messages[:upto]))
    return f"{plain:.300}" or "they cannot be read"


def _own_file() -> Path | None:
    """Return the file of a person's own options, if there is one."""
    try:
        file = _OWN.expanduser()
    except RuntimeError:
        # There is no home.
        return None
    return file if file.is_file() and os.access(file, os.R_OK) else None


@contextmanager
def _alone() -> Iterator[None]:
    """Let Open MPI start neither a daemon nor a network for a process that nothing has started as one of several.

    It saves 0.3 s.  Variables that are set already stay; those set here are removed again, so children do not see them.
    """
    launched = any(name in os.environ for name in _LAUNCHED)
    # In TMPDIR it makes a folder for itself, and ends the program with a page where it cannot.
    variables = {} if launched else _ALONE | os.environ | {"TMPDIR": _temporary()}
    before = {name: os.environ.get(name) for name in (*_ALONE, "TMPDIR") if name in variables}
    os.environ.update((name, variables[name]) for name in before)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def _temporary() -> str:
    """Return a folder for temporary files that can be written to: ``TMPDIR``'s if it is one."""
    try:
        return tempfile.gettempdir()
    except OSError:
        named = os.environ.get("TMPDIR", "/tmp")
        raise InputError(f"TMPDIR {named}: cannot be written to; name a folder that can be") from None


@contextmanager
def petsc_errors() -> Iterator[None]:
    """Turn errors that PETSc raises, such as an unknown solver type, into one-line `InputError`."""
    try:
        yield
    except Exception as problem:
        petsc = sys.modules.get("petsc4py.PETSc")
        kind = getattr(petsc, "Error", None) if petsc else None
        # Some builds of slepc4py return beside raising, of which Python makes an error of its own.
        error = problem.__cause__ if isinstance(problem, SystemError) else problem
        if kind is None or not isinstance(error, kind):
            raise
        lines = [re.sub(r"^\[\d+\] ", "", text).strip() for text in str(error).splitlines()]
        messages = [text for text in lines if text and not re.match(r"error code|\w+\(\) (line|at)", text)]
        raise InputError(f"PETSc: {' '.join(messages) or lines[0]} (see -help)") from None


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
