"""``isorod show``: the rods of a scene with their control points, and what they meet, before anything is solved."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from isorod.command import chosen, drawing, notes
from isorod.command.parser import Parser


def main(ours: Sequence[str], theirs: Sequence[str] = ()) -> int:
    """Show the rods of a scene in a window, or write a picture of them; return the exit code."""
    if chosen.usage("show", ours, theirs):
        return 0
    scene, args, _ = chosen.choose("show", ours, theirs, more)
    window = drawing.prepare("show", args)
    from isorod.output import picture, shape, solids

    model, start, words = None, None, [scene.title]
    if scene.analysis == "geometry":
        rods = [*scene.rods()]
        for rod in rods:
            rod.check()
    else:
        model = scene.model()
        rods = [body.space.rod for body in model.bodies]
        if scene.analysis == "dynamics":
            start = scene.settings().get("displacement")
        words += [solids.summary(one, name) for one, name in zip(model.solids, scene.solid_names(), strict=True)]
    with picture.stage(args.size, window) as plotter:
        shape.draw(plotter, rods, model, start, "\n".join(words), args.view, args.size)
        if window:
            picture.wait(plotter)
        else:
            picture.save(picture.taken(plotter), Path(args.png))
            print(f"{args.png}: {args.size[0]} x {args.size[1]} pixels")
    print(*(f"solid {line}\n" for line in words[1:]), sep="", end="")
    notes.show()
    return 0


def more(parser: Parser, scene: Any) -> None:
    """Add the options of a picture."""
    drawing.add_options(parser)
