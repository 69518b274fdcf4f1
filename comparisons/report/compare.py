"""The part of the report page of a scene solved by both methods."""

import html
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from comparisons.measure.convergence import time_at
from comparisons.measure.quantities import FREQUENCIES, Converged
from comparisons.measure.records import Record, family, is_ours, part
from comparisons.measure.variants import BODIES, DEFAULT
from comparisons.measure.work import MODULES
from comparisons.report import plots, precision
from comparisons.report.html import columns, commands, figure, fold, milliseconds, percent, table
from comparisons.report.html import section as section_of

# Of what is measured, and of stress, which has an error of its own: what a default is to be within, and the errors at
# which run times are compared.
ERROR, STRESS = "error", "stress"
TOLERANCES = {ERROR: 5e-3, STRESS: 0.03}
TARGETS = {ERROR: (1e-2, 5e-3, 1e-3, 1e-4), STRESS: (0.1, 0.03, 0.01, 3e-3)}


def summary(records: list[Record]) -> list[str]:
    """Return the main findings, one line each."""
    name, default = _scene(records)["name"], _default(records)
    within = f"{100 * TOLERANCES[ERROR]:g} %: {verdict(records)}{_stress_verdict(records)}"
    lines = [f"{name}: default ({family(default)}) within {within}; {_of_default(records)}"]
    sentences = (_beside(records), _stress_sentence(records), _beside(records, STRESS), _field_sentence(default))
    lines += [f"{name}: {text}" for text in sentences if text]
    for what, word in ((ERROR, ""), (STRESS, " stress")):
        for target, ours, theirs in _pairs(records, what):
            fast, slow = ours["seconds"]["total"], theirs["seconds"]["total"]
            lines.append(
                f"{name}{word} within {100 * target:g} %: isorod ({family(ours)}) {milliseconds(fast)} ms "
                f"({ours['dofs']:,} unknowns), dolfinx {milliseconds(slow)} ms ({theirs['dofs']:,}): "
                f"{precision.ratio(fast, slow)} the time"
            )
    return lines


def answer(records: list[Record]) -> list[str]:
    """Return the main findings as HTML."""
    name, default = _scene(records)["name"], _default(records)
    lines = [
        f"<p class=big><strong>{html.escape(name)}:</strong> {_by(default)} isorod ({family(default)}) is "
        f"{_percent(default['error'])} off: within {100 * TOLERANCES[ERROR]:g} %: <strong>{verdict(records)}</strong>"
        f"{_stress_verdict(records, '<strong>{}</strong>')}. "
        f"{_sentence(_beside(records))}</p>"
        f"<p>{_sentence(_of_default(records))} {_sentence(_stress_sentence(records))} "
        f"{_sentence(_beside(records, STRESS))} {_sentence(_field_sentence(default))}</p>"
    ]
    rows = [
        (f"{percent(target)}{word}", ours, theirs, [theirs])
        for what, word in ((ERROR, ""), (STRESS, ", stress"))
        for target, ours, theirs in _pairs(records, what)
    ]
    return [*lines, precision.side_by_side(rows, precision.versions(records)[:1], _label)] if rows else lines


def section(records: list[Record], folder: Path) -> list[str]:
    """Write the plots of a comparison and return its HTML."""
    scene, work = _scene(records), part(records, "work")
    name = scene["name"]
    file = f"{records[-1]['study']}-errors.png"
    plots.labelled(work, {what: uncertainty(records, what) for what in (ERROR, STRESS)}, folder / file)
    parts = {
        "error against run time": figure(
            file,
            f"{name}: errors against run time, both axes logarithmic",
            "Lower is more accurate, further left is faster. Each point is a run: of isorod <em>default</em>, and what "
            "is changed of it: N, the degree of polynomials across the section, K and n, order and number of control "
            "points of the other families, p, the degree along the axis, e, the number of elements; of dolfinx how "
            "many times as many cells as in the coarsest mesh there are in each direction. "
            f"{_refined(records)}Lines join runs that are refined in all directions. First the largest error of what "
            "the scene measures, against the limit of the meshes; then those of "
            f"{'stress and of ' if STRESS in _default(records) else ''}the field, against "
            f"{'that limit and ' if _measured_stresses(records) else ''}the finest mesh, which has none itself.",
        ),
        "what it measures": _measured(records),
        "fields": [
            _field_words(records),
            _field_table(records),
            *(figure(one["file"], one["alt"], one["caption"]) for one in part(records, "picture")),
        ],
        "every run, raw data, running it again": _closing(records),
    }
    return section_of(name, f"<p>{_sentence(html.escape(scene['title']))} {_what(records)}</p>", parts)


def verdict(records: list[Record], what: str = ERROR) -> str:
    """Return whether isorod's default is within the target error, as far as finite elements resolve it.

    That of stress is the larger one of those against finite elements and against isorod's own finest space.
    """
    finer = [one["stress"] for one in part(records, "finer") if what == STRESS]
    error, target, doubt = max([_default(records)[what], *finer]), TOLERANCES[what], uncertainty(records, what)
    word = "yes" if error <= target else "no"
    if abs(error - target) < doubt:
        word += f", but finite elements converged to {_percent(doubt)} only"
    return word


def _stress_verdict(records: list[Record], style: str = "{}") -> str:
    """Return the verdict on stress; nothing where there is none."""
    if STRESS not in _default(records):
        return ""
    return f", stress within {100 * TOLERANCES[STRESS]:g} %: {style.format(verdict(records, STRESS))}"


def uncertainty(records: list[Record], what: str = ERROR) -> float:
    """Return the largest relative uncertainty of the finite elements' limits, of measured quantities or of stress.

    Of stress at surfaces that is how far the mesh before the finest is from that.
    """
    measured = _measured_stresses(records)
    if what == STRESS and not measured:
        meshes = [one[STRESS] for one in _meshes(records) if STRESS in one]
        return float(min((one for one in meshes if one > plots.SHOWN), default=0.0))
    known = [one for one in _reference(records) if not one.vanishes and (one.name in measured) == (what == STRESS)]
    return max((one.uncertainty for one in known), default=0.0)


def at_equal_error(work: Sequence[Record], error: float, what: str = ERROR) -> tuple[float, str] | None:
    """Return the finite elements' run time to an error, interpolated between runs of an element on finer meshes.

    Where all that an element has is less accurate, that of its finest mesh, and ``"more than"``; where all is more
    accurate, that of its coarsest, and ``"at most"``.  Of several elements that of the fastest.
    """
    times = []
    for curve in dict.fromkeys(one["curve"] for one in work if one["method"] == "fem"):
        runs = sorted((one for one in work if one["curve"] == curve), key=lambda one: one["dofs"])
        times.append(time_at([one[what] for one in runs], [one["seconds"]["total"] for one in runs], error))
    reached = [one for one in times if one[1] != "more than"]
    return min(reached or times, default=None)


def _scene(records: list[Record]) -> Record:
    return part(records, "scene")[0]


def _default(records: list[Record]) -> Record:
    return next(one for one in part(records, "work") if one["label"] == DEFAULT)


def _reference(records: list[Record]) -> list[Converged]:
    return [Converged(**one) for one in part(records, "converged")[0]["quantities"]]


def _meshes(records: list[Record]) -> list[Record]:
    """Return the finite elements' runs that are compared with, coarse to fine."""
    return [one for one in part(records, "work") if one["method"] == "fem" and one["sequence"]]


def _measured_stresses(records: list[Record]) -> list[str]:
    """Return the names of the stresses that the scene measures, as far as they are not zero."""
    names = [name for one in part(records, "scene") for name in one.get("stresses", ())]
    return [one.name for one in _reference(records) if one.name in names and not one.vanishes]


def _pairs(records: list[Record], what: str = ERROR) -> list[tuple[float, Record, Record]]:
    """Return errors that finite elements resolve and both sides reach, each with the fastest runs within."""
    pairs = []
    for target in TARGETS[what]:
        within = [one for one in part(records, "work") if one.get(what, np.inf) <= target]
        best = [
            min(
                (one for one in within if one["method"] == method),
                key=lambda one: one["seconds"]["total"],
                default=None,
            )
            for method in MODULES
        ]
        if target >= uncertainty(records, what) and best[0] and best[1]:
            pairs.append((target, best[0], best[1]))
    return pairs


def _of_default(records: list[Record]) -> str:
    """Return the default's errors in words, its own estimate beside them."""
    default, doubt = _default(records), uncertainty(records)
    errors = ", ".join(f"{name.replace('_', ' ')} {_percent(error)}" for name, error in default["errors"].items())
    own = f"; isorod's own estimate {_percent(default['error_estimate'])}" if "error_estimate" in default else ""
    return f"error of {errors or 'nothing measured'}; finite elements converged to {_percent(doubt)}{own}"


def _by(default: Record) -> str:
    # Some scenes choose what a file leaves open: rods in contact need control points.
    rods = default["options"].get("rod")
    silent = bool(rods) and not any(one.get("space") for one in rods.values())
    chosen = silent or all({"elements", "degree"} <= {*one["chosen"]} for one in default["discretisation"])
    return "with nothing chosen by hand" if chosen else "on the space that its file gives it"


def _beside(records: list[Record], what: str = ERROR) -> str:
    """Return the ratio of run times at the default's error."""
    default, doubt = _default(records), uncertainty(records, what)
    if what not in default:
        return ""
    theirs = at_equal_error(part(records, "work"), max(default[what], doubt), what)
    if theirs is None:
        return ""
    fast, (slow, how) = default["seconds"]["total"], theirs
    of = " of stress" if what == STRESS else ""
    near = f"{_percent(doubt)}{of}, which is as far as finite elements converged"
    to = f"the same error{of}" if default[what] >= doubt else near
    ratio = precision.ratio(fast, slow)
    least = {"more than": "less than ", "at most": "at least ", "": ""}[how] if fast < slow else ""
    return f"it takes {milliseconds(fast)} ms, {least}{ratio} the {milliseconds(slow)} ms of dolfinx to {to}"


def _field_sentence(default: Record) -> str:
    """Return how far the default's fields are from the finest mesh's."""
    field = default["field"]
    if "shape" in field:
        return f"mode shapes within {_percent(field['shape'])} of dolfinx' on its finest mesh"
    return f"displacement field (L2) {_percent(field['displacement'])} from dolfinx' on its finest mesh"


def _stress_sentence(records: list[Record]) -> str:
    """Return the default's error of stress: of which stress, against what, and isorod's own estimate."""
    default, names = _default(records), ", ".join(name.replace("_", " ") for name in _measured_stresses(records))
    if STRESS not in default:
        return ""
    what = f"stress ({names})" if names else "von Mises stress at surfaces, a diameter and more from edges,"
    against = "the limit of dolfinx' meshes" if names else "dolfinx' finest mesh"
    doubt = _percent(uncertainty(records, STRESS))
    words = f"{what} {_percent(default[STRESS])} from {against}, which converged to {doubt}"
    for one in part(records, "finer"):
        words += f", and {_percent(one['stress'])} from isorod's finest space ({one['label']})"
    if "stress_error_estimate" in default:
        words += f"; isorod's own estimate {_percent(default['stress_error_estimate'])}"
    return words


def _what(records: list[Record]) -> str:
    scene, default = _scene(records), _default(records)
    elements = html.escape("; ".join(dict.fromkeys(one["element"] for one in default["discretisation"])))
    kind = {"statics": "Equilibrium", "modal": "Vibration modes", "dynamics": "Motion, in the same implicit steps"}[
        scene["analysis"]
    ]
    fem = [one for one in part(records, "work") if one["method"] == "fem"]
    degree = part(records, "converged")[0]["degree"]
    cells = f"bricks of degree {degree}, curved with the rods, of nested meshes"
    if _is_joined(records):
        cells = (
            f"all rods and bodies as one solid, curved tetrahedra of degree {degree} by gmsh, smallest at the edges of "
            "joints"
        )
    return (
        f"{kind}. isorod as <code>isorod run {html.escape(scene['word'])}</code> has it: {elements}; "
        f"{precision.unknowns(default)} degrees of freedom{_bodies_sentence(default)}. dolfinx: {cells}, "
        f"{fem[0]['dofs']:,} to {max(one['dofs'] for one in fem):,} degrees of "
        "freedom, solved directly; finite elements that are faster to an error may exist, none were searched for."
        + (f" Both ran on {scene['ranks']} ranks." if scene.get("ranks", 1) > 1 else "")
    )


def _is_joined(records: list[Record]) -> bool:
    """Return whether finite elements have all rods and bodies as one solid."""
    return any(one.get("shape") == "tetrahedron" for one in part(records, "work"))


def _refined(records: list[Record]) -> str:
    """Return what runs are whose bodies are refined, if there are any."""
    if not any(one["curve"] == BODIES for one in part(records, "work")):
        return ""
    return (
        "Of <em>bodies 1, 2</em>, bodies have meshes as fine as dolfinx' mesh 1, 2; of other runs those of the file. "
    )


def _bodies_sentence(default: Record) -> str:
    """Return the bodies' meshes in words."""
    bodies = [f"{one['cells']:,} {one['kind']} of degree {one['degree']}" for one in default.get("solids", ())]
    return f", with bodies of {' and '.join(bodies)}, as their files have them" if bodies else ""


def _measured(records: list[Record]) -> str:
    default, units = _default(records), _scene(records)["units"]
    rows: list[tuple[object, ...]] = []
    for one in _reference(records):
        label = one.name.replace("_", " ")
        values = default["values"][one.name]
        for k, value in enumerate(one.values):
            many = len(one.values) > 1
            each = one.name == FREQUENCIES
            name = f"mode {k + 1}" if each else f"{label} {'xyz'[k]}" if len(one.values) == 3 else f"{label} {k + 1}"
            size = abs(value) if each else float(np.linalg.norm(one.values))
            rows.append(
                (
                    name if many else label,
                    f"{value:.7g}",
                    f"{one.uncertainties[k]:.1g}",
                    _order(one.orders[k], one),
                    f"{values[k]:.7g}",
                    _percent(abs(values[k] - value) / size) if size else "",
                )
            )
        if one.vanishes:
            rows.append((f"{label}: zero, as far as the meshes converged", "", "", "", "", ""))
    text = "; ".join(f"{html.escape(one.replace('_', ' '))} {html.escape(unit)}" for one, unit in units.items() if unit)
    two = len(_meshes(records)) < 3
    head = ("", "finest mesh" if two else "limit of the meshes", "±", "order", "isorod, default", "difference")
    note = (
        "<p>A third mesh was left out, and two show no limit: ± is how far the finest is from the one before.</p>"
        if two
        else "<p>The limit is extrapolated from three meshes where they approach one (order: of how many times the "
        "cells' size the error goes down; below 1, as where stresses at edges of held faces have no limit, as if it "
        "were 1), and ± is then how far the finest mesh is from it. Elsewhere it is the finest mesh's, and ± how far "
        "that is from the mesh before.</p>"
    )
    return (f"<p>Units: {text}.</p>" if text else "") + table(head, rows) + note


def _order(order: float | None, one: Converged) -> str:
    if order is not None:
        return f"{order:.1f}"
    return "the same on all" if one.given else "none shown"


def _field_words(records: list[Record]) -> str:
    scene = _scene(records)
    if scene["analysis"] == "modal":
        return (
            "<p>Of each mode shape of dolfinx' finest mesh, the part that the best combination of a run's shapes with "
            "frequencies within 2 % does not have, in L2 over the volume; the largest is given, without modes as high "
            "as the last, which may be one of a pair.</p>"
        )
    own, doubt = [one["field"] for one in _meshes(records) if one["field"].get("displacement", 0.0) > plots.SHOWN], ""
    if own:
        doubt = f" dolfinx' own mesh before the finest is {_percent(own[-1]['displacement'])} from it"
        doubt += f", of stress {_percent(own[-1]['stress'])}: less is not resolved." if "stress" in own[-1] else "."
    return (
        "<p>Against the finest mesh: the displacement in L2 over the volume, relative; von Mises stress at the same "
        "places of surfaces on both sides, as the displacement there makes it: the largest difference, relative to the "
        "largest stress, and that stress. Places are farther from ends, held places and jumps of laws than the section "
        f"is wide: at edges stresses have no limit.{doubt}</p>"
    )


def _field_table(records: list[Record]) -> str:
    work = part(records, "work")
    shown: dict[str, Callable[[Record], object]] = {"run": _named, "unknowns": precision.unknowns}
    if any("shapes" in one["field"] for one in work):
        work = [one for one in work if "shapes" in one["field"]]
        shown["largest"] = lambda one: _percent(one["field"]["shape"])
        for k in range(len(work[0]["field"]["shapes"])):
            shown[f"mode {k + 1}"] = lambda one, k=k: _percent(one["field"]["shapes"][k])  # type: ignore[misc]
        return table(*columns(work, shown))
    shown["ms"] = precision.total
    for name in ("displacement", "stress"):
        shown[name] = lambda one, name=name: _percent(one["field"].get(name))  # type: ignore[misc]
    if _measured_stresses(records):
        # What counts as the error of stress, where that is another.
        shown["stress measured"] = lambda one: _percent(one.get(STRESS))
    shown["largest stress"] = lambda one: f"{one['field']['peak']:.5g}" if "peak" in one["field"] else ""
    return table(*columns(work, shown))


def _closing(records: list[Record]) -> list[str]:
    scene, study, level = _scene(records), records[-1]["study"], records[-1]["level"]
    work = part(records, "work")
    word = shlex.quote(scene["word"])
    again = [f"isorod compare {word}" + ("" if level == "quick" else f" --level {level}")]
    if scene.get("ranks", 1) > 1:
        again = [f"{again[0]} --ranks {scene['ranks']}"]
    for one in (_default(records), [one for one in work if one["method"] == "fem"][-1]):
        words = ["rods", word] if one["method"] == "fem" else [word]
        again.append(" ".join(f"python -m {MODULES[one['method']]} {' '.join(words)} {one['arguments']}".split()))
    return [
        f'<p>Every run is a line of JSON in <a href="{study}.jsonl">{study}.jsonl</a>, with options, times by part, '
        "versions, commit and machine. To run it again, and isorod's default and the last of dolfinx' runs alone:</p>"
        + commands(again),
        fold(f"All {len(work)} runs", precision.runs(work), *precision.refused(records)),
    ]


def _named(record: Record) -> str:
    return (
        f"{precision.named(record)}, {record['label']}" if record["method"] == "fem" else f"isorod, {record['label']}"
    )


def _label(record: Record) -> str:
    return record["label"] + (f", {family(record)}" if is_ours(record) else "")


def _percent(value: Any) -> str:
    """Return a fraction in percent; nothing for none, and rounding as such."""
    if value is None:
        return ""
    return percent(value) if value > 1e-7 else "0 %"


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}" if text else ""
