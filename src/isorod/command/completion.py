"""Shell completion of ``isorod``: commands, scenes, options and their values."""

import os
import shlex
from collections.abc import Iterable
from contextlib import suppress
from importlib import import_module
from pathlib import Path

from isorod import scenes
from isorod.command import chosen, pages
from isorod.command.parser import Parser
from isorod.errors import InputError
from isorod.output.results import refusal

# Bash asks the command itself; file names are its own to complete.
_ASKS = 'complete -o bashdefault -o default -C "isorod --complete" isorod'

# Commands that take a scene, of which some need a program of its own for its options.
_OPTIONS = ("run", "show", "sweep", "matrices", "section")


def install() -> int:
    """Write the completion where bash looks for it; print how other shells use it.  Return the exit code."""
    data = os.environ.get("XDG_DATA_HOME") or os.path.expanduser("~/.local/share")
    path = Path(data) / "bash-completion" / "completions" / "isorod"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{_ASKS}\n")
    except OSError as problem:
        raise refusal(f"{path}: cannot be written", problem) from None
    print(f"{path} written: new bash shells complete isorod (with the package bash-completion; without it and in zsh,")
    print(f"after 'autoload -U bashcompinit && bashcompinit', put this line into .bashrc or .zshrc)\n{_ASKS}")
    return 0


def main() -> int:
    """Print the completions at the cursor in ``COMP_LINE``, one a line; return the exit code."""
    line = os.environ.get("COMP_LINE", "")[: int(os.environ.get("COMP_POINT") or 0) or None]
    with suppress(InputError, ValueError):
        words = shlex.split(line)[1:]
        begun = "" if line.endswith(" ") or not words else words.pop()
        print(*(word for word in _candidates(words, begun) if word.startswith(begun)), sep="\n")
    return 0


def _candidates(words: list[str], begun: str) -> Iterable[str]:
    if not words:
        return [*pages.PAGES, "--help", "--version", "--install-completion"]
    command, *rest = words
    if command == "new" and rest[-1:] == ["--from"]:
        from isorod.command.new import EXAMPLES

        return EXAMPLES
    if command == "new":
        return ["--from", "--help"]
    if command not in pages.USAGES:
        return ["--help"]
    if command in ("plot", "view"):
        return _words(import_module(f"isorod.command.{command}").parser(), rest)
    if not any(word in scenes.SCENES or word.endswith(".toml") for word in rest):
        return [*scenes.SCENES, *(str(path) for path in Path().glob(f"{begun}*.toml")), "--help"]
    if command not in _OPTIONS:
        return ["--level", "--results", "--help"] if command == "compare" else ["--level", "--element", "--help"]
    return _words(chosen.find(command, rest, (), import_module(f"isorod.command.{command}").more)[2], rest)


def _words(parser: Parser, before: list[str]) -> Iterable[str]:
    """Return the options of a parser, or the values that the one before can have: none if the shell knows better."""
    if before and parser.takes_value(before[-1]):
        return parser.choices(before[-1])
    return parser.options
