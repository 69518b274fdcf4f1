"""Fields of configurations that are options of the command line too: the default and the help text stand once."""

import argparse
import dataclasses
from typing import Any

from comparisons.fem.quadrature import RULES


def positive(text: str) -> int:
    """Return a positive whole number, as `argparse` asks for it."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"got {value}, need at least 1")
    return value


def rule(text: str) -> int | str:
    """Return the degree of a quadrature rule, or its name."""
    try:
        return text if text in RULES else int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}, need a degree or {' or '.join(RULES)}") from None


def option(default: Any, about: str, metavar: str | None = None, **more: Any) -> Any:
    """Return a field that is an option.

    Parameters
    ----------
    default
        Of both.
    about
        Help text.
    metavar, more
        For `argparse`; ``type`` is that of the default where not given.
    """
    given = more if metavar is None else more | {"metavar": metavar}
    return dataclasses.field(default=default, metadata={"option": {"help": about} | given})


def add_options(parser: argparse.ArgumentParser, configuration: Any) -> None:
    """Make each field that is an option a ``--long-option``."""
    for field in dataclasses.fields(configuration):
        if "option" in field.metadata:
            flag = f"--{field.name.replace('_', '-')}"
            parser.add_argument(
                flag, **{"default": field.default, "type": type(field.default)} | field.metadata["option"]
            )
