"""The scene that words of a command line choose, with its options and those of its analysis."""

import argparse
import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from isorod import files, scenes
from isorod.command.parser import Parser, add_fields, field_values
from isorod.errors import InputError

PETSC = "Options with a single dash go to PETSc untouched (-snes_monitor, -ksp_type gmres, -log_view, -help ...)."

# Commands that solve nothing, and take none of PETSc's options.
_ALONE = ("show",)

# Adds the options of a command to a parser, of a scene's class or of the scene of a file.
More = Callable[[Parser, Any], None]


class Chosen(NamedTuple):
    """A scene with its options, all options as parsed, and the words that say which (the scene's name left out)."""

    scene: Any
    found: argparse.Namespace
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
    words = [*ours[:place], *ours[place + 1 :]]
    found = parser.known(words)
    return Chosen(_typed(scene, found), found, words)


def usage(command: str, ours: Sequence[str], theirs: Sequence[str]) -> bool:
    """Return whether help alone is asked for, with no scene; it is printed."""
    if ours[:1] not in (["-h"], ["--help"]) and (ours or theirs):
        return False
    more = "" if command in _ALONE else " [-petsc_option value ...]"
    print(f"usage: isorod {command} SCENE [--option value ...]{more}\n")
    print("scenes: " + ", ".join(scenes.SCENES) + " ('isorod list' says what they are), or a file NAME.toml")
    print("('isorod new' writes one to begin with)" + ("" if command in _ALONE else f"\n{PETSC}"))
    return True


def find(command: str, ours: Sequence[str], theirs: Sequence[str], more: More) -> tuple[int, Any, Parser]:
    """Return where the scene's name stands, also behind options, its class or the scene of a file, and its parser.

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


def _typed(scene: Any, found: argparse.Namespace) -> Any:
    """Return the scene of a class, or that of a file, with the options that were typed."""
    if isinstance(scene, type):
        return scene(**field_values(found, scene))
    names = {field.name for field in dataclasses.fields(scene)}
    typed = {name: value for name, value in vars(found).items() if name in names and value is not None}
    return dataclasses.replace(scene, **typed) if typed else scene


def _is_scene(word: str) -> bool:
    return word in scenes.SCENES or (word.endswith(".toml") and not word.startswith("-"))


def _parser(command: str, name: str, scene: Any, more: More) -> Parser:
    """Return the parser of the fields of a scene class, or of a file's scene, and of a command's own options."""
    description = first_line(scene) if isinstance(scene, type) else scene.title
    about = None if command in _ALONE else PETSC
    parser = Parser(prog=f"isorod {command} {name}", description=description, epilog=about, allow_abbrev=False)
    if isinstance(scene, type) or scene.analysis != "geometry":
        add_fields(parser, scene)
    more(parser, scene)
    if not isinstance(scene, type):
        parser.add_argument(
            "--set",
            action="append",
            dest="changes",
            metavar="PATH=VALUE",
            help="override a value of the file: rod.NAME.law.NeoHookean.nu=0.3, support.NAME.displacement.2=0.5 "
            "(may be repeated)",
        )
        # What is not typed is as the file says.
        known = {action.dest for action in parser._actions}
        parser.set_defaults(**{name: None for name in _FROM_FILE if name in known})
    return parser


# Options of analyses that files too give.
_FROM_FILE = "load_steps", "at_rest", "modes", "mass", "integrator"


def with_analysis(parser: Parser, scene: Any) -> None:
    """Add what the analyses of a scene can be told, but for what keeps and refines them."""
    analyses = scenes.analyses(scene)
    if "statics" in analyses:
        steps = getattr(scene, "load_steps", 1)
        parser.add_argument(
            "--load-steps", type=int, default=steps, metavar="int", help=f"initial number of equal load steps ({steps})"
        )
        parser.add_argument(
            "--stable", action="store_true", help="from an unstable equilibrium continue to a stable one"
        )
    if "modal" in analyses:
        parser.add_argument(
            "--modes", type=int, default=10, metavar="int", help="number of modes besides rigid-body modes (10)"
        )
        parser.add_argument(
            "--mass",
            choices=("consistent", "lumped"),
            default="consistent",
            help="mass matrix (consistent); lumped is right for bending, not for torsion",
        )
        # A scene of a class that has modes has no loads.
        if not isinstance(scene, type):
            parser.add_argument(
                "--load-steps",
                type=int,
                metavar="int",
                help="initial number of equal load steps to the equilibrium (1)",
            )
            parser.add_argument(
                "--at-rest",
                action="store_true",
                help="modes of the undeformed state: no loads, prescribed displacements or spin",
            )
    if "dynamics" in analyses:
        parser.add_argument(
            "--integrator",
            choices=("explicit", "implicit"),
            default="explicit",
            help="time integration (explicit); implicit is unconditionally stable",
        )


def settings(scene: Any, found: argparse.Namespace) -> dict[str, Any]:
    """Return the keyword arguments of the scene's analysis: what is typed before what a file says."""
    own = scene.settings()
    typed: dict[str, Any]
    if scene.analysis == "modal":
        typed = {"modes": found.modes, "lumped": found.mass and found.mass == "lumped"}
        typed |= {name: getattr(found, name, None) for name in ("load_steps", "at_rest")}
    elif scene.analysis == "dynamics":
        typed = {"integrator": found.integrator}
    else:
        if found.load_steps is not None and found.load_steps < 1:
            raise InputError(f"load steps: got {found.load_steps}, need at least 1")
        typed = {"load_steps": found.load_steps, "stable": getattr(found, "stable", None) or None}
    return own | {name: value for name, value in typed.items() if value is not None}


def first_line(scene_type: Any) -> str:
    """Return the first line of what a scene's class says of itself."""
    return (scene_type.__doc__ or "").strip().splitlines()[0]
