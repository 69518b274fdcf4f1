"""The ``isorod`` command: the first word chooses one of its commands."""

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NamedTuple

from isorod import __version__, memory, scenes
from isorod.command import ending, notes, pages
from isorod.command.parser import Parser, split
from isorod.errors import InputError


class Command(NamedTuple):
    """A command with its own options: ``main(ours, theirs)`` of the module with its name.

    It takes our options and PETSc's, and returns the exit code.
    """

    help: str
    petsc: bool = False


# Commands that take a scene and its options after their name.
COMMANDS = {
    "run": Command("solve a scene, or a scene file", petsc=True),
    "show": Command("show the rods of a scene with their control points, in a window or as a picture"),
    "plot": Command("plot results of a run: fields on the deformed shape, animations, or curves"),
    "view": Command("view results of a run in a browser: rotate, step through, read off values"),
    "sweep": Command("parameter study: solve a scene for all combinations of option values, into a table", petsc=True),
    "design": Command("vary numbers of a scene until its results meet requirements", petsc=True),
    "identify": Command("fit numbers of a scene, such as constants of its laws, to measured curves", petsc=True),
    "matrices": Command("write the matrices of a scene or a file for other programs", petsc=True),
    "mesh": Command("write hexahedra of the rods of a scene or a file: .msh, .inp, .vtu"),
    "section": Command("print stiffness and mass per length of a rod's cross-section, 6 x 6, for beam codes"),
    "compare": Command("compare a scene with finite elements: errors and run times"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line; return the exit code, other than 0 with one line on standard error."""
    return ending.run("isorod", lambda: command(sys.argv[1:] if arguments is None else arguments))


def command(arguments: Sequence[str]) -> int:
    """Run the command that the first word names; return the exit code."""
    notes.keep()
    ours, theirs = split(arguments)
    if ours[:1] == ["--complete"]:
        from isorod.command import completion

        return completion.main()
    chosen_command = COMMANDS.get(ours[0]) if ours else None
    if theirs == ["-help"] and not (chosen_command and chosen_command.petsc and len(ours) > 1):
        ours, theirs = [*ours, "--help"], []
    if theirs and not (chosen_command and chosen_command.petsc):
        raise InputError(f"option {theirs[0]}: PETSc options go with 'isorod run SCENE'")
    behind = next((word for word in ours if word in COMMANDS), None)
    if behind and ours[0].startswith("--"):
        raise InputError(f"option {ours[0]}: put it after the command: isorod {behind} SCENE {ours[0]}")
    if chosen_command:
        memory.refuse_little()
        done: int = import_module(f"isorod.command.{ours[0]}").main(ours[1:], theirs)
        return done
    parser = _parser()
    args = parser.known(ours)
    if args.command == "list":
        return _list()
    if args.command == "new":
        from isorod.command import new as starter

        return starter.main(args.name, args.origin)
    if args.command == "compile":
        from isorod.command import compile as ahead

        return ahead.main()
    if args.command == "doctor":
        from isorod.command import doctor

        return doctor.main()
    if args.completion:
        from isorod.command import completion

        return completion.install()
    parser.print_help()
    return 2


def _list() -> int:
    """Print the ready scenes and the examples, each with its analysis and title."""
    from isorod.command import new

    print("isorod run SCENE:")
    for name in scenes.SCENES:
        scene = scenes.find(name)
        print(f"  {name:10s} {scenes.analyses(scene)[0]:10s} {scene.title}")
    print("\nisorod new NAME.toml --from EXAMPLE (as a scene file):")
    for name, (analysis, title) in new.listed().items():
        print(f"  {name:16s} {analysis:10s} {title}")
    return 0


def _parser() -> Parser:
    """Return the parser of the commands without a scene; its help lists the others too."""
    parser = Parser(
        prog="isorod",
        description="Rods as full 3-D continua through surface control points.",
        epilog="isorod COMMAND --help: what a command reads and writes, with an example.",
    )
    parser.add_argument("--version", action="version", version=f"isorod {__version__}")
    about = "install completion of commands, scenes and options for bash, and print how to enable it in zsh"
    parser.add_argument("--install-completion", action="store_true", dest="completion", help=about)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)
    for name, entry in COMMANDS.items():
        commands.add_parser(name, help=entry.help, add_help=False)
    simple = {
        "list": "list the scenes and the examples",
        "new": "write a scene file to begin with",
        "compile": "compile all functions ahead of the first run",
        "doctor": "show versions, what is missing and how to get it",
    }
    raw = argparse.RawDescriptionHelpFormatter
    parsers = {
        name: commands.add_parser(name, help=text, description=pages.PAGES[name], formatter_class=raw)
        for name, text in simple.items()
    }
    new = parsers["new"]
    new.add_argument("name", nargs="?", default="my.toml", metavar="NAME.toml", help="name of the file (my.toml)")
    new.add_argument("--from", default="starter", dest="origin", metavar="EXAMPLE", help="spring, ring ... (starter)")
    return parser
