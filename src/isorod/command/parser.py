"""The command line: our options and PETSc's separated, scenes' fields as options."""

import argparse
import difflib
import math
import re
import types
import typing
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NoReturn

from isorod.errors import InputError

if TYPE_CHECKING:
    from _typeshed import SupportsWrite

_NUMBER = r"(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line (`InputError`).

    Attributes
    ----------
    elsewhere
        Options of other scenes, and why this one does not have them.
    own
        Options of the scene.
    """

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self.elsewhere: dict[str, str] = {}
        self.own: list[str] = []
        # argparse itself takes -1e-3, and -1,0,0, for an option.
        self._negative_number_matcher = re.compile(rf"-{_NUMBER}(,-?{_NUMBER})*$")

    def error(self, message: str) -> NoReturn:
        """Raise `InputError`."""
        raise InputError(f"{message} (see {self.prog} --help)")

    def print_help(self, file: "SupportsWrite[str] | None" = None) -> None:
        """Print the help; a full disk is an error, which argparse since Python 3.12 keeps to itself."""
        print(self.format_help(), end="", file=file)

    def known(self, arguments: Sequence[str]) -> argparse.Namespace:
        """Parse, and name what is not known together with the nearest option there is."""
        for word in arguments:
            # argparse itself makes an empty list of this value.
            if word.startswith("--") and word.endswith("=--"):
                self.error(f"argument {word[:-3]}: expected one argument")
        several = any(action.nargs == "*" for action in self._get_positional_actions())
        # Names of files, any number of them, may stand between options.
        parse = self.parse_known_intermixed_args if several else self.parse_known_args
        namespace, unknown = parse(arguments)
        if unknown:
            word = unknown[0].split("=")[0]
            if word in self.elsewhere:
                self.error(f"option {word}: {self.elsewhere[word]}")
            # Dashes that all have would make all of them near.
            names = {name.strip("-"): name for action in self._actions for name in action.option_strings}
            near = difflib.get_close_matches(word.strip("-"), names, 1)
            known = f"; of the scene there are: {', '.join(self.own)}" if self.own else ""
            self.error(f"option {word} is not known" + (f"; did you mean {names[near[0]]}?" if near else known))
        return namespace

    @property
    def options(self) -> list[str]:
        """All options of the help, with two dashes."""
        visible = (action for action in self._actions if action.help is not argparse.SUPPRESS)
        return [name for action in visible for name in action.option_strings if name.startswith("--")]

    def choices(self, word: str) -> list[str]:
        """Return the values that an option can have, if these are few."""
        return [*(self._option_string_actions[word].choices or ())]

    def takes_value(self, word: str) -> bool:
        """Return whether a word is an option whose value is the next one, whatever that is."""
        action = self._option_string_actions.get(word)
        return action is not None and action.nargs not in (0, "?")


def add_fields(parser: Parser, scene: Any) -> None:
    """Make each option of a scene a ``--long-option``.

    True or false ones (false where not given) take no value, sequences may be repeated.
    """
    for field in scene.option_fields:
        kind: Any = field.type
        if isinstance(kind, types.UnionType):
            kind = typing.get_args(kind)[0]
        flag = field.metadata.get("flag", "--" + field.name.replace("_", "-"))
        parser.own.append(flag)
        if typing.get_origin(kind) is Sequence:
            more = {name: field.metadata[name] for name in ("help", "metavar")}
            parser.add_argument(flag, dest=field.name, action="append", **more)
            continue
        shown = field.metadata["help"] + ("" if field.default is None else f" ({field.default})")
        if kind is bool:
            parser.add_argument(flag, dest=field.name, action="store_true", help=field.metadata["help"])
            continue
        parser.add_argument(flag, dest=field.name, type=kind, default=field.default, metavar=kind.__name__, help=shown)
        if "was" in field.metadata:
            factor = 180.0 / math.pi if field.metadata.get("radians") else 1.0
            hidden: Any = {"default": argparse.SUPPRESS, "help": argparse.SUPPRESS}
            parser.add_argument(
                field.metadata["was"], dest=field.name, type=kind, action=_Former, now=flag, factor=factor, **hidden
            )


class _Former(argparse.Action):
    """An option by its former name: its value is used, with a warning that names the present option."""

    def __init__(self, *arguments: Any, now: str, factor: float, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self._now, self._factor = now, factor

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        """Keep the value under the present name."""
        degrees = "" if self._factor == 1.0 else ", in degrees"
        warnings.warn(f"{option_string}: renamed, use {self._now}{degrees}", FutureWarning, stacklevel=2)
        setattr(namespace, self.dest, values if self._factor == 1.0 else values * self._factor)


def field_values(args: argparse.Namespace, scene: Any) -> dict[str, Any]:
    """Return a scene's options as parsed."""
    return {field.name: getattr(args, field.name) for field in scene.option_fields}


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
