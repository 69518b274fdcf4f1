"""Common parts of the commands that draw: the options of a picture, and its file."""

import argparse
import os
from pathlib import Path

from isorod.command import pages
from isorod.command.parser import Parser
from isorod.errors import InputError
from isorod.output import picture
from isorod.output.results import check_folder


def of_results(command: str, files: str) -> Parser:
    """Return the parser of a command that draws results of a run, with the names of its ``files``."""
    result = Parser(
        prog=f"isorod {command}",
        description=pages.PAGES[command],
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    result.add_argument("place", metavar="DIR", help=f"a results folder, or a {files} file of it")
    result.add_argument("--run", type=int, metavar="int", help="which of the folder's runs, from 1 (the last)")
    return result


def add_options(parser: Parser) -> None:
    """Add the options of a picture."""
    parser.add_argument("--png", metavar="FILE", help="write the picture into this file; without it a window opens")
    parser.add_argument(
        "--view",
        type=_view,
        metavar="x,y,z",
        help="view direction, from the rod to the eye (one from which little is foreshortened)",
    )
    size = "x".join(map(str, picture.SIZE))
    parser.add_argument(
        "--size", type=_size, default=picture.SIZE, metavar="WxH", help=f"width and height in pixels ({size})"
    )


def prepare(command: str, args: argparse.Namespace, files: tuple[str, ...] = ("png",), curves: bool = False) -> bool:
    """Return whether a window opens, as no file is named; raise `InputError` where nothing can be drawn.

    ``files`` are the options that name one in its place; ``curves`` are drawn without pyvista.
    """
    named = [name for name in files if getattr(args, name) is not None]
    for name in named:
        path = Path(getattr(args, name))
        if not os.path.isdir(path.absolute().parent) or (os.path.exists(path) and not os.path.isfile(path)):
            reason = "it is no plain file" if os.path.exists(path) else "there is no such folder"
            raise InputError(f"{path}: cannot be written ({reason}); name another")
        check_folder(str(path.absolute().parent), f"{path}: cannot be written")
    if curves:
        picture.check_size(args.size, command)
    else:
        picture.check(args.view, args.size, command)
    if not named:
        picture.need_display("--png FILE")
    return not named


def _view(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r:.40}, need a direction x,y,z such as 1,-1,0.5") from None


def _size(text: str) -> tuple[int, ...]:
    try:
        width, height = (int(word) for word in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r:.40}, need width and height such as 1000x700") from None
    return width, height
