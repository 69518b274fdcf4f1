"""What `isorod run` prints for people: the answer first, then its size, time and convergence, and how it came about."""

import atexit
import os
import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from typing import Any

import numpy as np

from isorod.command import vibrations
from isorod.output.words import duration, percent

_WIDTH, _INDENT = 80, 20

# Numbers of a list that are shown, and contacts.
_MOST, _FEW = 12, 3

# Deviation from the input geometry, over the radius, below which it is round-off.
_ROUNDING = 1e-9

# Fraction of the largest of several numbers below which others are round-off.
_NOISE = 1e-10

# Gaps and jumps of ties below this fraction of the size of their surface are round-off.
_NOTHING = 1e-12


@contextmanager
def apart() -> Iterator[None]:
    """Send what is printed within to standard error, and what PETSc prints when the process ends."""
    own = sys.stdout is not None and sys.stdout is sys.__stdout__
    kept = os.dup(1) if own else None
    try:
        if own:
            sys.stdout.flush()
            os.dup2(2, 1)
            atexit.register(_leave)
        with redirect_stdout(sys.stderr):
            yield
    finally:
        if kept is not None:
            os.dup2(kept, 1)
            os.close(kept)


def _leave() -> None:
    sys.stdout.flush()
    os.dup2(2, 1)


def summary(record: Mapping[str, Any], scene: Any) -> str:
    """Return a record in words, on one screen of 80 columns.

    Parameters
    ----------
    record
        From `isorod.command.solving`.
    scene
        Its ``units`` give the results to print, their order and units.
    """
    rows = [
        *_answer(record, scene.units, scene.stresses),
        *(_buckling(record, scene) if "factors" in record else ()),
        *(vibrations.rows(record) if "resonances" in record else ()),
        *_shape(record, scene),
        *_effort(record),
        *_origin(record, scene),
    ]
    lines = []
    for label, text in rows:
        lines += textwrap.wrap(
            f"{label} ".ljust(_INDENT) + text,
            _WIDTH,
            subsequent_indent=" " * _INDENT,
            break_long_words=False,
            break_on_hyphens=False,
        )
    return "\n".join(lines)


def _answer(record: Mapping[str, Any], units: Mapping[str, str], stresses: Sequence[str]) -> Iterator[tuple[str, str]]:
    places, named = record.get("places", {}), record.get("names", {})
    for name, unit in units.items():
        if name not in record:
            continue
        value = np.asarray(record[name])
        if name == "frequencies" and "rigid" in record:
            value = value[record["rigid"] :]
            unit += f", besides {_count(record['rigid'], 'rigid-body mode')}" if record["rigid"] else ""
        # What is over time has as many rows as there are outputs.
        moving = "times" in record and value.shape[:1] == np.shape(record["times"])
        text = _numbers(value[-1] if moving else value)
        if value.size > _MOST and not moving:
            text += f" and {value.size - _MOST} more"
        if moving and value.ndim == 1:
            # What swings to the other side has its largest there.
            peak = value[np.argmax(np.abs(value))]
            text += f" at the end, largest {peak:.6g}" if abs(peak) > abs(value[-1]) else ""
        place = places.get(name)
        where = _place(place[-1] if isinstance(place, list) else place) if place else ""
        yield name.replace("_", " "), f"{text} {unit}".rstrip() + where
    if record.get("analysis") == "modal":
        yield from _state(record)
    names = named.get("contacts")
    touching = [(k, one) for k, one in enumerate(record.get("contacts", ())) if one["active"]]
    for k, one in touching[:_FEW]:
        yield f"contact {names[k]}" if names else "contact", _contact(one)
    if touching[_FEW:]:
        yield "contacts", f"{len(touching) - _FEW} more"
    welds, ties = record.get("ties", ()), named.get("ties")
    for k, one in enumerate(welds[:_FEW]):
        yield f"tie {ties[k] if ties else k}", _tie(one)
    if welds[_FEW:]:
        yield "ties", f"{len(welds) - _FEW} more, largest jump {max(one['jump'] for one in welds):.2g}"
    if "estimate_seconds" in record and not {"error_estimate", "stress_error_estimate"} & record.keys():
        alone = "compare with finer meshes and more elements" if record.get("solids") else ""
        alone = "linear factors of the state of rest have none" if record.get("equilibria") == 0 else alone
        yield "error", f"no estimate: {alone or 'interior supports, laws that flow, or no finer space available'}"
    elif "error_estimate" in record:
        also = _stress_error(record, stresses)
        how = "by a finer space"
        if record.get("solids"):
            alone = (
                "of the meshes of solids alone, by" if record.get("contacts") else "by a finer space of the rods, and"
            )
            how = f"{alone} recovered strains"
        yield "error", f"about {percent(record['error_estimate'])}{also}, {how}"
    if record.get("time_error") is not None:
        yield "error in time", f"about {percent(record['time_error'])} of the largest displacement, by the time step"


def _stress_error(record: Mapping[str, Any], stresses: Sequence[str]) -> str:
    """Return the stress error away from edges as text, or that it is unknown though stresses were requested."""
    if "stress_error_estimate" in record:
        return f", of stresses {percent(record['stress_error_estimate'])}"
    return f" (of stresses, {', '.join(stresses)}, not known: compare with more elements)" if stresses else ""


def _state(record: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Return the state modes are about, unless it is the undeformed one, and its stability."""
    if record["about"] != "the state of rest":
        yield "about", record["about"]
    falling = sum(one < 0.0 for one in record["frequencies"][record["rigid"] :])
    if falling:
        yield "unstable", f"{_count(falling, 'mode')} shown below zero, growing in time (omega^2 < 0)"
    elif record.get("falling"):
        yield "critical", f"{_count(record['falling'], 'motion')} gyroscopically stabilised, without damping"


def _buckling(record: Mapping[str, Any], scene: Any) -> Iterator[tuple[str, str]]:
    """Return critical loads, mode shapes, linear load factors, and the state they are about."""
    if "critical_load" in record:
        sizes = ", ".join(f"{one:.6g}" for one in record["critical_loads"][:_MOST])
        yield "critical load", f"{sizes} ({scene.named(record['critical_load'])})"
    rods = scene.rod_names()
    for k, one in enumerate(record["largest"][:_FEW]):
        which = f"rod {rods[int(one['body'])]}, " if len(rods) > 1 else ""
        yield f"mode {k + 1}", f"moves most at {which}u = {one['u']:.4g}, radius {one['radius']:.4g}"
    if len(record["linear"]) and not np.array_equal(record["linear"], record["factors"]):
        yield "linear", ", ".join(f"{one:.6g}" for one in record["linear"][:_MOST]) + ", of the state of rest"
    yield "about", record["about"]


def _numbers(values: Any, digits: int = 6) -> str:
    """Return the first numbers as text, those at round-off of the largest as 0."""
    flat = np.ravel(values)
    noise = _NOISE * np.abs(flat).max(initial=0.0) if flat.size > 1 else 0.0
    return ", ".join(f"{0.0 if abs(item) < noise else item:.{digits}g}" for item in flat[:_MOST])


def _place(place: Mapping[str, float]) -> str:
    """Return where a largest value is."""
    return f", the largest: at u = {place['u']:.4g}, angle {place['angle']:.4g}, radius {place['radius']:.4g}"


def _contact(contact: Mapping[str, Any]) -> str:
    """Return peak pressure, penetration and resolution of a contact patch as text."""
    return (
        f"peak {contact['peak']:.3g} ({100.0 * contact['peak_error']:.0f} %), depth "
        f"{percent(contact['relative_penetration'])} of radius, {contact['points_across']:.2g} points wide"
    )


def _tie(tie: Mapping[str, Any]) -> str:
    """Return force, moment, gap, jump and slip of a tie as text."""
    force, moment = (_numbers(tie[name], 4) for name in ("force", "moment"))
    slip = f", slip {tie['slip']:.3g}" if tie["slip"] else ""
    gap, jump = (0.0 if tie[name] < _NOTHING * np.sqrt(tie["area"]) else tie[name] for name in ("gap", "jump"))
    return f"force {force}; moment {moment}; gap {gap:.2g}, jump {jump:.2g}{slip}"


def _shape(record: Mapping[str, Any], scene: Any) -> Iterator[tuple[str, str]]:
    """Return the largest deviation from the input geometry, unless it is round-off."""
    deviations = record.get("deviation", ())
    if not deviations:
        return
    worst = max(deviations, key=lambda one: one["relative"])
    if worst["relative"] > _ROUNDING:
        what = {"line": "centre line", "section": "outline", "sweep": "sections along the line"}
        part = max(what, key=lambda name: worst[name])
        rods = scene.rod_names()
        which = f" of {rods[deviations.index(worst)]}" if len(rods) > 1 else ""
        yield "deviation", f"{worst[part]:.2g} at most, {percent(worst['relative'])} of the radius: {what[part]}{which}"


def _effort(record: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if "seconds" not in record:
        return
    yield "size", f"{record['unknowns']:,} unknowns ({record['dofs']:,} degrees of freedom)"
    seconds = record["seconds"]
    names = {"setup": "set-up"} | {name: name for name in ("equilibrium", "assembly", "solve", "check")}
    parts = ", ".join(f"{names[part]} {duration(time)}" for part, time in seconds.items() if part in names)
    apart = f"; import {duration(seconds['import'])} apart" if "import" in seconds else ""
    yield "time", f"{duration(seconds['total'])} ({parts}){apart}"
    yield "convergence", "; ".join(_convergence(record))


def _convergence(record: Mapping[str, Any]) -> Iterator[str]:
    if "steps" in record:
        yield f"{_count(record['steps'], 'time step')} of {record['time_step']:.4g}"
        yield f"energy within {np.abs(record['energy_error']).max():.1g} of the work done"
        yield f"momentum within {np.abs(record['momentum_error']).max():.1g}"
        if record["resumed"] is not None:
            yield f"continued from time {record['resumed']:.6g}"
    if record.get("newton_iterations"):
        yield _count(record["newton_iterations"], "Newton iteration")
    if "load_steps" in record:
        yield _count(record["load_steps"], "load step")
    if record.get("cuts"):
        yield f"{_count(record['cuts'], 'cutback')} of the step size"
    if "residual_norms" in record:
        yield f"residual force {record['residual_norms'][-1]:.1g}, initially {record['residual_norms'][0]:.3g}"
    if "equilibria" in record:
        yield f"modes about {_count(record['equilibria'], 'equilibrium', 'equilibria')}"
    if record.get("settled") is not None:
        yield f"load factors settled within {record['settled']:.1g}"
    if "iterations" in record:
        yield f"{_count(record['iterations'], 'restart')} of the eigensolver"
    if "residuals" in record:
        yield f"relative residuals within {np.max(record['residuals']):.1g}"
        yield f"{_count(record['rigid'], 'rigid-body mode')}" if record.get("rigid") else "no mode missed (Sturm count)"


def _element(discretisation: Mapping[str, Any]) -> str:
    chosen = [name.replace("_", " ") for name in discretisation["chosen"]]
    mixed = "; mixed formulation" if discretisation["formulation"] == "mixed" else ""
    return f"{discretisation['element']}{mixed}" + (f" (chosen: {', '.join(chosen)})" if chosen else "")


def _count(number: int, what: str, several: str = "") -> str:
    return f"{number:,} {what if number == 1 else several or f'{what}s'}"


def _origin(record: Mapping[str, Any], scene: Any) -> Iterator[tuple[str, str]]:
    """Return what was solved, how, and by which versions."""
    yield "scene", f"{record['scene']}, {record['analysis']}; {scene.described}"
    if "solver" not in record:
        yield "more", "--json prints all there is on one line, --output DIR keeps it"
        return
    yield "element", "; ".join(dict.fromkeys(_element(one) for one in record["discretisation"]))
    for one in record.get("solids", ()):
        yield "solid", f"{one['cells']:,} {one['kind']} of degree {one['degree']}, {one['nodes']:,} nodes"
    solver = ", ".join(f"{part} {name}" for part, name in record["solver"].items())
    built = " and ".join(record["built"]) or "nothing"
    yield "method", f"{solver}; {built} built; {_count(record['ranks'], 'rank')}"
    if record["petsc_options"]:
        yield "PETSc options", record["petsc_options"]
    yield "versions", ", ".join(f"{name} {version}" for name, version in record["versions"].items())
    histories = ", histories" if "times" in record else ""
    yield "more", f"--json prints all{histories}; --output DIR keeps it with the fields"
