"""``isorod section``: stiffness and mass per length of a rod's section, in words, as JSON and as a CSV file."""

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isorod.command import chosen, ending, notes
from isorod.command.parser import Parser
from isorod.errors import InputError

if TYPE_CHECKING:
    from isorod.model.body import Body

_MATRICES = {
    "stiffness": "stiffness [force; force length; force length^2]",
    "mass": "mass per length [mass/length; mass; mass length]",
}

# Fraction of the size below which values are round-off.
_NOTHING = 1e-12

_ORDER = (
    "Rows and columns: axial force N; shear Q1, Q2 along the section's first and second direction; torsion T; bending "
    "moments M1, M2 about these; about the section's centroid, of the straight prism that has it."
)
_FIRST = (
    "The first direction is the section's x: at the start of an arc or a helix away from its axis; of other curves "
    "towards their `normal`, or, without one, x under the smallest rotation that takes z to the curve's tangent."
)


def main(ours: Sequence[str], theirs: Sequence[str]) -> int:
    """Print the properties of a section of a scene's rod; return the exit code."""
    if chosen.usage("section", ours, theirs):
        return 0
    scene, args, _ = chosen.choose("section", ours, theirs, more)
    if args.output is not None and Path(args.output).suffix != ".csv":
        raise InputError(f"--output: got {args.output}, need a file that ends in .csv")
    from isorod.output import results
    from isorod.output.section_properties import FORCES, section_properties

    name, body = _rod(scene, args.rod)
    properties = section_properties(body, _parameter(args.u), progress=ending.rank() == 0)
    record: dict[str, Any] = {
        "scene": scene.name,
        "rod": name,
        "order": list(FORCES),
        "range": body.space.axis.breaks[[0, -1]].tolist(),
        **{one: getattr(properties, one) for one in _KEPT},
        **results.provenance(),
    }
    # Before anything is written: a record that cannot be one is an error.
    line = results.line(record)
    if ending.rank() == 0:
        if args.output is not None:
            results.write_whole(Path(args.output), _csv(record).encode())
        notes.show()
        print(line if args.json else _words(record))
    return 0


# Properties in the record of a section.
_KEPT = (
    "u area centroid frame stiffness mass EA GA GJ EI tension_centre shear_centre principal_angle error functions"
).split()


def more(parser: Parser, scene: Any) -> None:
    """Add the options that choose the section and its output."""
    parser.add_argument("--rod", metavar="NAME", help="rod of the scene: its name in a file, or its number (the first)")
    parser.add_argument("--u", default="start", metavar="U", help="axis parameter, start or end (start)")
    parser.add_argument("--json", action="store_true", help="print the result as one line of JSON")
    parser.add_argument("--output", metavar="FILE.csv", help="write both matrices into this file")


def _rod(scene: Any, requested: str | None) -> "tuple[str, Body]":
    """Return the name and the body of the requested rod."""
    if scene.analysis == "geometry":
        raise InputError("section: this scene is geometry alone, without the laws that a stiffness needs")
    # A scene file adds the place in the file to errors.
    with scene.locating():
        bodies = scene.model().bodies
    names = scene.rod_names() or [str(k) for k in range(len(bodies))]
    if requested is None:
        return names[0], bodies[0]
    if requested in names:
        return requested, bodies[names.index(requested)]
    if requested.isdecimal() and int(requested) < len(bodies):
        return names[int(requested)], bodies[int(requested)]
    raise InputError(f"--rod: got {requested!r}, need one of {', '.join(names)}")


def _parameter(text: str) -> str | float:
    try:
        return float(text)
    except ValueError:
        return text


def _csv(record: Mapping[str, Any]) -> str:
    """Return both matrices as a table: which one, the row, and its numbers."""
    lines = [",".join(["matrix", "row", *record["order"]])]
    for name in _MATRICES:
        if not record[name].any():
            # No density is no mass.
            continue
        for row, values in zip(record["order"], record[name], strict=True):
            lines.append(",".join([name, row, *(repr(float(value)) for value in values)]))
    return "\n".join(lines) + "\n"


def _words(record: Mapping[str, Any]) -> str:
    """Return a record on one screen of 80 columns."""

    def several(values: Any, size: float = 1.0) -> str:
        # Round-off is printed as 0.
        return ", ".join(f"{value if abs(value) > _NOTHING * size else 0.0:.6g}" for value in values)

    size = record["area"] ** 0.5
    low, high = record["range"]
    lines = [
        f"section of {record['scene']}, rod {record['rod']}, at u = {record['u']:.6g} of {low:g} to {high:g}; "
        f"area {record['area']:.6g}"
    ]
    lines += textwrap.wrap(_ORDER, 80)
    for name, title in _MATRICES.items():
        matrix = record[name]
        scale = abs(matrix.diagonal()) ** 0.5
        whole = matrix * (abs(matrix) > _NOTHING * scale[:, None] * scale) + 0.0
        if not whole.any():
            lines += ["", "no mass: the rod has no density"]
            continue
        lines += ["", title, "    " + "".join(f"{one:>12}" for one in record["order"])]
        for row, values in zip(record["order"], whole, strict=True):
            lines.append(f"{row:<4}" + "".join(f"{value:12.5g}" for value in values))
    normal, first, second = record["frame"]
    lines += [
        "",
        *textwrap.wrap(_FIRST, 80),
        f"centroid            ({several(record['centroid'], size)})",
        f"first direction     ({several(first)})",
        f"second direction    ({several(second)})",
        f"normal              ({several(normal)})",
        f"tension centre      ({several(record['tension_centre'], size)}) from the centroid, in these directions",
        f"shear centre        ({several(record['shear_centre'], size)})",
        f"principal axes      turned by {record['principal_angle']:.6g} degrees about the normal",
        f"EA, GJ              {several([record['EA'], record['GJ']])}",
        f"EI, about these     {several(record['EI'])}",
        f"GA, along these     {several(record['GA'])}, with shear coefficients",
        f"estimated error     {100.0 * max(record['error'], _NOTHING):.2g} %, on {record['functions']}",
    ]
    return "\n".join(lines)
