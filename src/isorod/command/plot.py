"""``isorod plot``: results of a run as fields on the deformed shape, animations or curves."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from isorod.command import drawing
from isorod.command.parser import Parser
from isorod.errors import InputError
from isorod.output import animation, picture, reading
from isorod.output.words import FIELDS, STRESS_ERROR, stress_error

# Stress fields: their pictures show the estimated stress error.
STRESSES = frozenset({"von_mises", "mean_stress", "cauchy"})

# Kinds of units by field, as scene files name them.
_UNITS = {"contact_pressure": "stress", "displacement": "length"} | dict.fromkeys(STRESSES, "stress")

# Arrays that define cells, and are no fields.
_INTERNAL = frozenset({"RationalWeights", "HigherOrderDegrees"})

# Largest displacement drawn with an automatic scale, over the size of the model.
SEEN = 0.12


def main(ours: Sequence[str], theirs: Sequence[str] = ()) -> int:
    """Draw a result; return the exit code."""
    args = parser().known(ours)
    if sum(one is not None for one in (args.png, args.gif)) > 1:
        raise InputError("--png and --gif: give one of them")
    result = reading.find(args.place, args.run)
    if args.curve is not None or (result.curves is not None and not result.steps):
        return _curves(result, args)
    window = drawing.prepare("plot", args, ("png", "gif"))
    if not result.steps:
        raise InputError(f"{args.place}: this run of {result.name} wrote no fields; isorod show draws geometry")
    chosen = _chosen(result, args)
    frames, scale, title, shape = _frames(result, chosen, args)
    images = picture.draw(frames, title, scale, args.view, args.size, window, shape)
    if args.gif:
        count = animation.save(images, Path(args.gif))
        print(f"{args.gif}: {count} frames of {args.size[0]} x {args.size[1]} pixels")
        return 0
    for image in images:
        picture.save(image, Path(args.png))
        print(f"{args.png}: {args.size[0]} x {args.size[1]} pixels")
    return 0


def parser() -> Parser:
    """Return the parser of the command's options."""
    result = drawing.of_results("plot", ".vtu, .pvd or .csv")
    result.add_argument("--colour", metavar="FIELD", help="field of the files, such as displacement (von_mises)")
    result.add_argument("--scale", metavar="float", help="deformation scale factor, or auto (1, of modes auto)")
    result.add_argument("--mode", type=int, metavar="int", help="which mode, from 1 (the first)")
    result.add_argument(
        "--time", type=float, metavar="float", help="time, or load factor, of the state drawn (the last)"
    )
    result.add_argument("--gif", metavar="FILE", help="write an animation of all times or load steps, or of a mode")
    result.add_argument(
        "--curve",
        nargs="?",
        const="",
        metavar="FILE.csv",
        help="draw curves against time, load or mode instead: those of the run, or of a file",
    )
    drawing.add_options(result)
    return result


def _chosen(result: reading.Result, args: argparse.Namespace) -> tuple[reading.Step, ...]:
    """Return the states to draw."""
    steps = result.steps
    if args.gif is not None:
        if args.time is not None:
            raise InputError("--time: an animation has all times; leave it out, or use --png")
        return steps
    if args.time is None:
        return steps[-1:]
    times = np.array([step.time for step in steps])
    if len(steps) == 1:
        raise InputError(f"--time: {result.name} has a single state")
    if not times[0] <= args.time <= times[-1]:
        raise InputError(f"--time: got {args.time:g}, need {times[0]:g} to {times[-1]:g}")
    return (steps[int(np.argmin(np.abs(times - args.time)))],)


def _frames(
    result: reading.Result, steps: Sequence[reading.Step], args: argparse.Namespace
) -> tuple[list[picture.Frame], float, str, bool]:
    """Return the frames, the deformation scale, the title of the colours, and whether a mode is drawn."""
    meshes = [[reading.mesh(path) for path in step.files] for step in steps]
    modes = modes_of(meshes[-1])
    if args.mode is not None and not modes:
        raise InputError(f"--mode: {result.name} has no modes; there are {', '.join(field_names(meshes[-1]))}")
    motion = "displacement"
    words = [result.title] * len(steps)
    if modes:
        number = 1 if args.mode is None else args.mode
        if not 1 <= number <= len(modes):
            raise InputError(f"--mode: got {number}, need 1 to {len(modes)}")
        motion = f"mode_{number}"
        words = [f"{result.title}\nmode {number}{frequency(result, number)}"] * len(steps)
    elif len(result.steps) > 1:
        digits = animation.written([step.time for step in result.steps])
        words = [f"{result.title}\n{result.counted} {step.time:{digits}}" for step in steps]
    if modes and args.gif and motion.replace("mode", "quarter") in meshes[-1][0].point_data:
        meshes = [[_whirled(mesh, motion, *factors) for mesh in meshes[-1]] for factors in animation.quarters()]
        words = words[-1:] * len(meshes)
    colour = _colour(meshes[-1], motion, args.colour, result.name)
    notes = [note_of(one) if colour in STRESSES else "" for one in meshes]
    for mesh in (mesh for frame in meshes for mesh in frame):
        _prepare(mesh, motion, colour)
    scale = _scale(args.scale, meshes, bool(modes))
    frames = [picture.Frame(one, text, note=note) for one, text, note in zip(meshes, words, notes, strict=True)]
    if args.gif is not None and len(frames) == 1:
        if not modes:
            raise InputError(f"--gif: {result.name} has a single state, nothing to animate; use --png")
        frames = [picture.Frame(meshes[0], words[0], factor) for factor in animation.amplitudes()]
    title = FIELDS.get("displacement" if modes else colour, colour.replace("_", " "))
    if unit := result.units.get(_UNITS.get(colour, "")):
        title = f"{title.splitlines()[0]}\n({unit})"
    return frames, scale, title, bool(modes)


def modes_of(meshes: Sequence[Any]) -> list[str]:
    """Return the names of the modes' shapes."""
    return [name for name in meshes[0].point_data if name.startswith("mode_")]


def field_names(meshes: Sequence[Any]) -> list[str]:
    """Return the names of the fields of all bodies, each once."""
    names = dict.fromkeys(name for mesh in meshes for name in mesh.point_data)
    return [name for name in names if name not in _INTERNAL]


def _colour(meshes: Sequence[Any], motion: str, given: str | None, name: str) -> str:
    """Return the field that the colours show."""
    fields = field_names(meshes)
    if motion.startswith("mode_"):
        if given not in (None, "displacement"):
            raise InputError(f"--colour: got {given}, a mode has displacement alone")
        return motion
    if given is not None and given not in fields:
        raise InputError(f"--colour: {name} has no field {given}; there are {', '.join(fields)}")
    if given is None:
        given = next((one for one in ("von_mises", "displacement", *fields) if one in fields), None)
    if given is None:
        raise InputError(f"{name}: its files have no fields")
    return given


def note_of(meshes: Sequence[Any]) -> str:
    """Return the note on the stress error of a state, from its files."""
    known = [float(mesh.field_data[STRESS_ERROR][0]) for mesh in meshes if STRESS_ERROR in mesh.field_data]
    return stress_error(max(known, default=None))


def _whirled(mesh: Any, motion: str, now: float, later: float) -> Any:
    """Return a mesh whose mode shape is ``now`` times it plus ``later`` times that a quarter of a period later."""
    combined = mesh.copy()
    parts = [np.asarray(mesh.point_data[name]) for name in (motion, motion.replace("mode", "quarter"))]
    combined.point_data[motion] = now * parts[0] + later * parts[1]
    return combined


def _prepare(mesh: Any, motion: str, colour: str) -> None:
    """Reduce a mesh to its ``motion`` and ``colour``; NaN where it has no such field."""
    fields = {name: np.asarray(values, dtype=float) for name, values in mesh.point_data.items()}
    values = fields.get(colour, np.full(mesh.n_points, np.nan))
    if motion.startswith("mode_"):
        # A mode about an equilibrium moves from the deformed state.
        mesh.points += fields.get("displacement", 0.0)
    mesh.clear_point_data()
    mesh.point_data["motion"] = fields.get(motion, np.zeros((mesh.n_points, 3)))
    mesh.point_data["colour"] = values if values.ndim == 1 else np.linalg.norm(values, axis=1)


def _scale(given: str | None, meshes: Sequence[Sequence[Any]], modes: bool) -> float:
    """Return the deformation scale factor."""
    if given is None and not modes:
        return 1.0
    if given not in (None, "auto"):
        try:
            value = float(given or "")
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise InputError(f"--scale: got {given!r:.40}, need a number or auto")
        return value
    points = np.concatenate([mesh.points for mesh in meshes[0]])
    size = float(np.ptp(points, axis=0).max())
    largest = max(float(np.linalg.norm(mesh.point_data["motion"], axis=1).max()) for one in meshes for mesh in one)
    return SEEN * size / largest if largest > 0.0 else 1.0


def frequency(result: reading.Result, number: int) -> str:
    """Return the frequency of a mode, or its load factor, as text; empty if the record has neither."""
    for name, words in (("frequencies", "frequency"), ("factors", "load factor")):
        values = result.record.get(name, ())
        if number <= len(values):
            return f": {words} {values[number - 1]:.5g}"
    return ""


def _curves(result: reading.Result, args: argparse.Namespace) -> int:
    """Draw curves of a run."""
    from isorod.output import curves

    for name in ("gif", "mode", "time", "colour", "scale"):
        if getattr(args, name) is not None:
            raise InputError(f"--{name}: curves have none; leave it out")
    path = Path(args.curve) if args.curve else result.curves
    if path is None:
        raise InputError(f"{args.place}: this run of {result.name} wrote no curves (.csv)")
    window = drawing.prepare("plot", args, curves=True)
    curves.draw(curves.read(path), result.title, args.size, None if window else Path(args.png), result.units)
    if not window:
        print(f"{args.png}: {args.size[0]} x {args.size[1]} pixels")
    return 0
