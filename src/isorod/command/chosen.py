"""The scene that words of a command line choose, with its options and those of its analysis."""

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from isorod import files, scenes
from isorod.command import notes, pages
from isorod.command.parser import Parser, add_fields, field_values
from isorod.errors import InputError

# Commands that solve nothing, and take none of PETSc's options.
_ALONE = ("show",)

# Adds the options of a command to a parser of a scene's.
More = Callable[[Parser, Any], None]


class Chosen(NamedTuple):
    """A scene with its options, all options as parsed, and the words without the scene's name."""

    scene: Any
    args: argparse.Namespace
    words: list[str]


def choose(command: str, ours: Sequence[str], theirs: Sequence[str], more: More) -> Chosen:
    """Return the scene that a command's words name, with the options typed.

    Parameters
    ----------
    command
        Its name, ``"run"``.
    ours, theirs
        Its words, and PETSc's.
    more
        Adds the command's options to those of the scene (`with_analysis` and others).

    Raises
    ------
    InputError
        If no scene is named, or an option is not known or has no value that it can have.
    """
    place, scene, parser = find(command, ours, theirs, more)
    if "-help" in theirs:
        # With --json standard output is the record's alone.
        parser.print_help(sys.stderr if "--json" in ours else None)
    words = [*ours[:place], *ours[place + 1 :]]
    args = parser.known(words)
    notes.name(scene.named)
    return Chosen(scene.with_options(**field_values(args, scene)), args, words)


def usage(command: str, ours: Sequence[str], theirs: Sequence[str]) -> bool:
    """Return whether help alone is asked for, or nothing at all; a command's page is printed."""
    if ours[:1] not in (["-h"], ["--help"]) and (ours or [*theirs] not in ([], ["-help"])):
        return False
    print(pages.page(command))
    return True


def find(command: str, ours: Sequence[str], theirs: Sequence[str], more: More) -> tuple[int, Any, Parser]:
    """Return where the scene's name stands, also behind options, the scene without options, and its parser.

    A name that is the value of an option before it is not meant.
    """
    for place, word in enumerate(ours):
        if (place == 0 and not word.startswith("-")) or _is_scene(word):
            scene = files.find(word)
            parser = _parser(command, word, scene, more)
            if place == 0 or not parser.takes_value(ours[place - 1]):
                return place, scene, parser
    taken = next((k for k in range(1, len(theirs)) if _is_scene(theirs[k])), None)
    if taken is not None:
        raise InputError(
            f"scene missing: {theirs[taken]} was read as the value of {theirs[taken - 1]}; put it first: "
            f"isorod {command} {theirs[taken]} {theirs[taken - 1]}"
        )
    names = ", ".join(scenes.SCENES)
    raise InputError(f"scene missing; known: {names}; put it first: isorod {command} SCENE {[*ours, *theirs][0]}")


def _is_scene(word: str) -> bool:
    return word in scenes.SCENES or (word.endswith(".toml") and not word.startswith("-"))


def _parser(command: str, name: str, scene: Any, more: More) -> Parser:
    """Return the parser of a scene's options, and of a command's own."""
    about = None if command in _ALONE else pages.PETSC
    parser = Parser(prog=f"isorod {command} {name}", description=scene.title, epilog=about, allow_abbrev=False)
    add_fields(parser, scene)
    more(parser, scene)
    return parser


def with_load_steps(parser: Parser, scene: Any) -> None:
    """Add the option of load steps; the scene's value is the default."""
    parser.add_argument(
        "--load-steps", type=int, metavar="int", help=f"initial number of equal load steps ({scene.load_steps})"
    )


def with_analysis(parser: Parser, scene: Any) -> None:
    """Add the options of a scene's analyses, except those of output and refinement; None: the scene's value."""
    analyses = scenes.analyses(scene)
    if {"statics", "modal"} & {*analyses}:
        with_load_steps(parser, scene)
    if "statics" in analyses:
        parser.add_argument(
            "--stable", action="store_true", help="from an unstable equilibrium continue to a stable one"
        )
    if "modal" in analyses:
        parser.add_argument("--modes", type=int, metavar="int", help="number of modes besides rigid-body modes (10)")
    if "buckling" in analyses:
        parser.add_argument("--modes", type=int, metavar="int", help="number of buckling modes (1)")
        parser.add_argument(
            "--linear-at",
            type=float,
            metavar="float",
            help="load factors by linearisation at the equilibrium of this one; 0: at the undeformed state, classical",
        )
    if "modal" in analyses:
        parser.add_argument(
            "--mass",
            choices=("consistent", "lumped"),
            help="mass matrix (consistent); lumped is right for bending, not for torsion",
        )
        parser.add_argument(
            "--at-rest",
            action="store_const",
            const=True,
            help="modes of the undeformed state: no loads, prescribed displacements or spin",
        )
    if "dynamics" in analyses:
        parser.add_argument(
            "--integrator",
            choices=("explicit", "implicit"),
            help="time integration (explicit); implicit is unconditionally stable",
        )


def settings(scene: Any, args: argparse.Namespace) -> dict[str, Any]:
    """Return the keyword arguments of the scene's analysis: typed options override those of a file."""
    own = scene.settings()
    typed: dict[str, Any]
    if scene.analysis == "modal":
        typed = {"modes": args.modes, "lumped": args.mass and args.mass == "lumped"}
        typed |= {name: getattr(args, name, None) for name in ("load_steps", "at_rest")}
    elif scene.analysis == "buckling":
        typed = {"modes": args.modes, "linear_at": args.linear_at}
    elif scene.analysis in ("harmonic", "random"):
        typed = {}
    elif scene.analysis == "dynamics":
        typed = {"integrator": args.integrator}
    else:
        if args.load_steps is not None and args.load_steps < 1:
            raise InputError(f"load steps: got {args.load_steps}, need at least 1")
        typed = {"load_steps": args.load_steps, "stable": getattr(args, "stable", None) or None}
    return own | {name: value for name, value in typed.items() if value is not None}
