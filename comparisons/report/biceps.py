"""The biceps' part of the report page."""

import html
from collections.abc import Callable
from operator import itemgetter
from pathlib import Path

import numpy as np

from comparisons.biceps import AT_REST, BALANCE, END_TIME, QUANTITIES, SPEED, errors
from comparisons.measure.records import Record, family, is_ours, part, side
from comparisons.report import biceps_plots
from comparisons.report.html import columns, figure, percent, table
from comparisons.report.html import section as section_of
from comparisons.report.precision import ratio, rerun, unknowns


def section(records: list[Record], folder: Path) -> list[str]:
    """Write the plots of a run of the study and return its HTML."""
    (limit,), (picture,) = part(records, "converged"), part(records, "picture")
    motions, theirs = part(records, "motion"), part(records, "fem motion")
    # The others are there for the time of their steps.
    curves = [record for record in theirs if len(record["history"]["time"]) > 2]
    biceps_plots.courses(motions, curves, folder / "biceps-motion.png")
    biceps_plots.work(part(records, "work"), QUANTITIES, folder / "biceps-work.png")
    mine, fem = picture["dofs"]
    about = (
        "<p>Two muscles between common tendons are activated within "
        f"{1e3 * motions[0]['options']['ramp']:g} ms, swell, press on each other and swing to rest within "
        f"{1e3 * END_TIME:g} ms. Lengths are in cm, forces in N. What are the forces at the ends, how far does the "
        "belly bulge, how hard do the muscles press? Finite elements: dolfinx, with its own contact and the same "
        "law.</p>"
    )
    return section_of(
        "Biceps",
        about,
        {
            "what was asked and what was found": _clauses(motions, limit, theirs),
            "von Mises stress": [
                figure(
                    picture["file"],
                    "initial shape, and von Mises stress at 5, 10, 15 ms and at equilibrium",
                    f"Above isorod ({mine:,} unknowns), below 27-node bricks in dolfinx ({fem:,}), in one colour "
                    "scale without light or shade: the bellies swell towards each other, and both sides show the same "
                    "stress at the same time.",
                ),
                figure(
                    picture["animation"],
                    "both motions, animated",
                    "The motion, left isorod, right dolfinx.",
                    fits=True,
                ),
            ],
            "the motion against time": figure(
                "biceps-motion.png",
                "bulge, end forces, contact force and area against time",
                "Left the time that the finite elements were run for, right all of it. Dashed lines at the right: the "
                "element's own equilibrium, found without following the motion; the motion has to end there.",
            )
            + _deviations(motions, curves)
            + _added_mass(motions),
            "what a step costs": _speed(motions, theirs),
            "the equilibrium, error against run time": [
                figure(
                    "biceps-work.png",
                    "error of three quantities against run time, log-log",
                    "Lower is more accurate, further left is faster; the line is what was asked. The area in contact "
                    "has no converged value to compare with.",
                ),
                _equilibria(records, limit),
            ],
            "raw data, running it again": rerun("biceps", records),
        },
    )


def summary(records: list[Record]) -> list[str]:
    """Return the study's main findings, one line each."""
    (limit,) = part(records, "converged")
    motions = part(records, "motion")
    rests = [
        f"{record['label']} end forces {percent(found['end_force'])}, bulge {percent(found['belly_bulge'])}, contact "
        f"force {percent(found['contact_force'])}"
        for record in motions
        for found in (errors(record["equilibrium"], limit),)
    ]
    lines = [f"biceps, equilibrium against converged dolfinx: {'; '.join(rests)}"]
    fem = whole(part(records, "fem motion")[0])
    for record in motions:
        lines.append(
            f"biceps, {1e3 * END_TIME:g} ms of motion: isorod ({family(record)}), {record['label']}, "
            f"{record['seconds']['loop']:.1f} s ({record['microseconds_a_step']:.0f} us a step), dolfinx on the "
            f"paper's mesh {fem:.0f} s (from {1e3 * _end(part(records, 'fem motion')[0]):g} ms): "
            f"{ratio(record['seconds']['loop'], fem)} the time"
        )
    return lines


def whole(record: Record) -> float:
    """Return the seconds that a finite element run would take for the whole motion.

    Time of a step by number of steps.
    """
    return float(record["seconds"]["step"] * END_TIME / record["time_step"])


def deviation(motion: Record, theirs: Record, name: str) -> float:
    """Return the root mean square of the difference of two courses over the finite elements' time, over that of theirs.

    ``name`` is a key of their ``history``; our course is interpolated at their times.
    """
    own = next(own for own, fem, _, _ in biceps_plots.COURSES if fem == name)
    times, values = np.array(theirs["history"]["time"]), np.array(theirs["history"][name])
    course = np.array(motion[own])
    columns = course.reshape(len(course), -1).T
    found = np.array([np.interp(times, motion["times"], column) for column in columns]).T.reshape(values.shape)
    return float(np.linalg.norm(found - values) / np.linalg.norm(values))


def _end(record: Record) -> float:
    return float(record["history"]["time"][-1])


def _clauses(motions: list[Record], limit: Record, theirs: list[Record]) -> str:
    """Return the table of what is asked of the motion and the equilibrium."""
    rows = []
    wanted = {name: percent(bound) for name, bound in QUANTITIES.items()}
    for record in motions:
        found = errors(record["equilibrium"], limit)
        held = [
            (f"{name.replace('_', ' ')} at equilibrium, against converged dolfinx", found[name], QUANTITIES[name])
            for name in wanted
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
        text = f"time of the motion, share of that of {theirs[0]['label']} in dolfinx"
        held.append((text, record["seconds"]["loop"] / whole(theirs[0]), SPEED))
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


def _step(record: Record) -> str:
    return f"{1e6 * record['time_step']:.3g}"


def _added_mass(motions: list[Record]) -> str:
    """Return how much of the kinetic energy is in mass that was added for the time step."""
    shown: dict[str, Callable[[Record], object]] = {
        "mass added for the time step": itemgetter("label"),
        "time step µs": _step,
        "share of the kinetic energy, mean": lambda one: percent(one["added_kinetic_share"]),
    }
    return (
        "<p>The mass is consistent; for steps longer than its critical one, some is added to fast waves. Courses then "
        "differ a little in "
        "time, while the equilibrium they end in does not.</p>" + table(*columns(motions, shown))
    )


def _speed(motions: list[Record], theirs: list[Record]) -> str:
    def fem(one: Record) -> bool:
        return "history" in one

    def share(other: Record) -> Callable[[Record], str]:
        return lambda one: "" if fem(one) else f"1/{whole(other) / one['seconds']['loop']:.0f}"

    span = f"{1e3 * END_TIME:g} ms"
    shown: dict[str, Callable[[Record], object]] = {
        "": lambda one: f"{'dolfinx' if fem(one) else side(one)}, {one['label']}",
        "unknowns": unknowns,
        "time step µs": _step,
        f"steps in {span}": lambda one: f"{END_TIME / one['time_step'] if fem(one) else one['steps']:,.0f}",
        "µs a step": lambda one: (
            f"{1e6 * one['seconds']['step']:,.0f}" if fem(one) else f"{one['microseconds_a_step']:.0f}"
        ),
        f"s for {span}": lambda one: f"{whole(one):.0f}" if fem(one) else f"{one['seconds']['loop']:.2f}",
        "measured over": lambda one: f"{one['steps']:,} steps, {1e3 * _end(one):.3g} ms" if fem(one) else "",
        **{f"share of {other['label']}": share(other) for other in theirs},
    }
    return table(*columns([*motions, *theirs], shown), text=(0, 6)) + (
        f"<p>The finite elements' {span} are not run: they are the measured time of a step (forces, "
        "contact and update; without samples and critical steps) by the number of steps at the last time step "
        "taken.</p>"
    )


def _equilibria(records: list[Record], limit: Record) -> str:
    def off(name: str) -> Callable[[Record], str]:
        return lambda one: (
            f"±{percent(limit['limits'][name]['uncertainty'])}" if one is limit else percent(one["error"][name])
        )

    def of_runs(text: Callable[[Record], str]) -> Callable[[Record], str]:
        return lambda one: "" if one is limit else text(one)

    shown: dict[str, Callable[[Record], str]] = {
        "": lambda one: "converged" if one is limit else side(one) if is_ours(one) else f"{one['curve']} (dolfinx)",
        # What the curve's name says is left out.
        "arguments": of_runs(lambda one: str(one["arguments"]).removeprefix("--cells bricks --degree 2 ")),
        "unknowns": of_runs(unknowns),
        "lower end N": lambda one: f"{one['end_force'][0]:.5g}",
        "bulge cm": lambda one: f"{one['belly_bulge']:.4g}",
        "contact N": lambda one: f"{one['contact_force']:.4g}",
        "area cm²": of_runs(lambda one: f"{one['contact_area']:.3g}"),
        **{title: off(name) for title, name in zip(("error: ends", "bulge", "contact"), QUANTITIES, strict=True)},
        "s": of_runs(lambda one: f"{one['seconds']['total']:.3g}"),
    }
    head, rows = columns([limit, *part(records, "work")], shown)
    # Numbers stay with their units.
    kept = [(*row[:2], *(text.replace(" ", "\u00a0") for text in row[2:])) for row in rows]
    return table(head, kept, text=(0, 1)) + (
        f"<p>Reference: {html.escape(limit['element'])}, uniformly refined; extrapolated where the values approach a "
        "limit, else the finest, with its distance from the one before. The area in contact has no reference: the "
        "bellies touch along a strip too narrow for the bricks as for the element's points of contact, and it does not "
        "settle.</p>"
    )
