"""The biceps' part of the report page."""

import html
from collections.abc import Callable
from operator import itemgetter
from pathlib import Path

import numpy as np

from comparisons.biceps import AT_REST, BALANCE, END_TIME, QUANTITIES, errors
from comparisons.measure.records import Record, family, part
from comparisons.report import biceps_plots
from comparisons.report.html import columns, figure, percent, table
from comparisons.report.html import section as section_of
from comparisons.report.precision import rerun


def section(records: list[Record], folder: Path) -> list[str]:
    """Write the plots of a run of the study and return its HTML."""
    (limit,), (picture,) = part(records, "converged"), part(records, "picture")
    motions, theirs = part(records, "motion"), part(records, "fem motion")
    biceps_plots.courses(motions, theirs, folder / "biceps-motion.png")
    mine, fem = picture["dofs"]
    about = (
        "<p>Two muscles between common tendons are activated within "
        f"{1e3 * motions[0]['options']['ramp']:g} ms, swell, press on each other and swing to rest within "
        f"{1e3 * END_TIME:g} ms. Lengths are in cm, forces in N. What are the forces at the ends, how far does the "
        "belly bulge, how hard do the muscles press? Finite elements: dolfinx, with its own contact and the same "
        f"law: {html.escape(limit['element'])}, uniformly refined. The area in contact has no reference: the bellies "
        "touch along a strip too narrow for the bricks as for the element's points of contact, and it does not "
        "settle.</p>"
    )
    return section_of(
        "Biceps",
        about,
        {
            "what was asked and what was found": _clauses(motions, limit),
            "von Mises stress": [
                figure(
                    picture["file"],
                    "initial shape, and von Mises stress at 5, 10, 15 ms and at equilibrium",
                    f"Above isorod ({mine:,} unknowns), below 27-node bricks in dolfinx ({fem:,}), in one colour "
                    "scale without light or shade: the bellies swell towards each other, and both sides show the same "
                    "stress at the same time.",
                ),
            ],
            "the motion against time": figure(
                "biceps-motion.png",
                "bulge, end forces, contact force and area against time",
                "Left the time that the finite elements were run for, right all of it. Dashed lines at the right: the "
                "element's own equilibrium, found without following the motion; the motion has to end there.",
            )
            + _deviations(motions, theirs)
            + _added_mass(motions),
            "the converged equilibrium": _converged(limit),
            "raw data, running it again": rerun("biceps", records),
        },
    )


def summary(records: list[Record]) -> list[str]:
    """Return the study's main findings, one line each."""
    (limit,) = part(records, "converged")
    motions = part(records, "motion")
    rests = [
        f"{record['label']} end forces {percent(off['end_force'])}, bulge {percent(off['belly_bulge'])}, contact "
        f"force {percent(off['contact_force'])}"
        for record in motions
        for off in (errors(record["equilibrium"], limit),)
    ]
    lines = [f"biceps, equilibrium against converged dolfinx: {'; '.join(rests)}"]
    for record in motions:
        lines.append(
            f"biceps, {1e3 * END_TIME:g} ms of motion: isorod ({family(record)}), {record['label']}, "
            f"{record['seconds']['loop']:.1f} s ({record['microseconds_a_step']:.0f} us a step)"
        )
    return lines


def deviation(motion: Record, theirs: Record, name: str) -> float:
    """Return the root mean square of the difference of two courses over the finite elements' time, over that of theirs.

    ``name`` is a key of their ``history``; our course is interpolated at their times.
    """
    own = next(own for own, fem, _, _ in biceps_plots.COURSES if fem == name)
    times, values = np.array(theirs["history"]["time"]), np.array(theirs["history"][name])
    course = np.array(motion[own])
    columns = course.reshape(len(course), -1).T
    interpolated = np.array([np.interp(times, motion["times"], column) for column in columns]).T.reshape(values.shape)
    return float(np.linalg.norm(interpolated - values) / np.linalg.norm(values))


def _end(record: Record) -> float:
    return float(record["history"]["time"][-1])


def _clauses(motions: list[Record], limit: Record) -> str:
    """Return the table of the criteria of the motion and the equilibrium."""
    rows = []
    bounds = {name: percent(bound) for name, bound in QUANTITIES.items()}
    for record in motions:
        errors_at_rest = errors(record["equilibrium"], limit)
        held = [
            (
                f"{name.replace('_', ' ')} at equilibrium, against converged dolfinx",
                errors_at_rest[name],
                QUANTITIES[name],
            )
            for name in bounds
        ]
        held.append(
            (
                f"end forces after {1e3 * END_TIME:g} ms, against the equilibrium",
                record["from_equilibrium"]["end_force"],
                AT_REST,
            )
        )
        held.append(("energy balance, share of the work done", float(np.abs(record["energy_error"]).max()), BALANCE))
        held.append(("momentum balance, share of the impulses", float(np.abs(record["momentum_error"]).max()), BALANCE))
        for text, value, bound in held:
            rows.append((record["label"], text, percent(value), percent(bound), "yes" if value <= bound else "no"))
    return table(("element", "", "found", "asked", "holds"), rows, text=(0, 1, 4))


def _deviations(motions: list[Record], theirs: list[Record]) -> str:
    def off(name: str) -> Callable[[tuple[Record, Record]], str]:
        return lambda pair: percent(deviation(*pair, name))

    shown: dict[str, Callable[[tuple[Record, Record]], object]] = {
        "root mean square deviation of the courses": lambda pair: (
            f"{pair[0]['label']} against {pair[1]['label']}, to {1e3 * _end(pair[1]):.0f} ms"
        ),
        **{fem.replace("_", " "): off(fem) for _, fem, _, _ in biceps_plots.COURSES},
    }
    return table(*columns(((record, other) for other in theirs for record in motions), shown))


def _added_mass(motions: list[Record]) -> str:
    """Return how much of the kinetic energy is in mass that was added for the time step."""
    shown: dict[str, Callable[[Record], object]] = {
        "mass added for the time step": itemgetter("label"),
        "time step µs": lambda one: f"{1e6 * one['time_step']:.3g}",
        "share of the kinetic energy, mean": lambda one: percent(one["added_kinetic_share"]),
    }
    return (
        "<p>The mass is consistent; for steps longer than its critical one, some is added to fast waves. Courses then "
        "differ a little in "
        "time, while the equilibrium they end in does not.</p>" + table(*columns(motions, shown))
    )


def _converged(limit: Record) -> str:
    shown: dict[str, Callable[[str], object]] = {
        "": lambda name: name.replace("_", " "),
        "extrapolated, or of the finest mesh": lambda name: f"{np.ravel(limit[name])[0]:.5g}",
        "known to": lambda name: percent(limit["limits"][name]["uncertainty"]),
    }
    return table(*columns(QUANTITIES, shown))
