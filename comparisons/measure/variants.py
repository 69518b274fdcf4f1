"""Coarser and finer discretisations of a scene, about the one that is taken where nothing is given."""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from typing import Any

from isorod.geometry.axis import MAX_DEGREE
from isorod.space import choice
from isorod.space.polynomial import MAX_DEGREE as MAX_SECTION_DEGREE

DEFAULT = "default"

# The curve of runs whose bodies have meshes as fine as finite elements' of one solid.
BODIES = "isorod, bodies refined"

# Options of a discretisation that are repeated where another one is changed.
_KEPT = ("section_degree", "order", "section_points", "elements", "degree", "continuity")


@dataclasses.dataclass(frozen=True)
class Variant:
    """A discretisation: a short label, and its options.

    ``sequence``: one of those refined in all directions together, coarse to fine.
    """

    label: str
    arguments: tuple[str, ...]
    sequence: bool = False


def variants(scene: Any, model: Any, known: Sequence[Mapping[str, Any]]) -> list[Variant]:
    """Return discretisations about that which was chosen, coarse to fine where all directions change together.

    Parameters
    ----------
    scene, model
        The scene, and its model as it is by default.
    known
        Of each body what was chosen, as in records (`isorod.model.body.Body.discretisation`).
    """
    base = _common(known)
    axes = [body.space.rod.axis for body in model.bodies]
    least, lowest = (max(getattr(axis, name) for axis in axes) for name in ("elements", "degree"))
    section, degree, elements = (base.get(name) for name in ("section_degree", "degree", "elements"))
    along: list[dict[str, int]] = [{}, {}]
    # About half as many, a multiple of the rod's own.
    half = least * -(-elements // (2 * least)) if elements is not None else 0
    if elements is not None and half < elements:
        along[0] = {"elements": half}
    elif degree is not None and degree > lowest + 1:
        along[0] = {"degree": degree - 1}
    if elements is not None:
        along[1] = {"elements": 2 * elements}
    elif degree is not None and degree < MAX_DEGREE:
        along[1] = {"degree": degree + 1}
    across: list[dict[str, int]] = [{}, {}, {}]
    if section is not None:
        steps = [section + step for step in (-1, 1, 2)]
        across = [{"section_degree": one} if 2 <= one <= MAX_SECTION_DEGREE else {} for one in steps]
    elif "order" in base and len(points := {body.space.points_around for body in model.bodies}) == 1:
        across[1] = {"order": max(2, base["order"]), "section_points": 2 * points.pop()}
    both = [across[0] | along[0], across[1] | along[1]]
    options: list[tuple[dict[str, int], bool]] = []
    for changed in (*both, *across, *along):
        if changed and changed not in [one for one, _ in options]:
            options.append((changed, changed in both))
    return [Variant(_label(base, one), _words(scene, model, base, one), sequence) for one, sequence in options]


def written(scene: Any, known: Sequence[Mapping[str, Any]]) -> str:
    """Return the options of a scene for the chosen discretisation, except short elements near ends."""
    return " ".join(_words(scene, None, _common(known), {}))


def _common(known: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    same = (name for name in _KEPT if len({one.get(name) for one in known}) == 1)
    return {name: known[0][name] for name in same if name in known[0]}


def _label(base: Mapping[str, int], changed: Mapping[str, int]) -> str:
    """Return the changes in the report's notation: ``N+1``, ``2e``, ``p-1``."""
    words = []
    for name, value in changed.items():
        if name == "elements":
            words.append("2e" if value > base[name] else "e/2")
        elif name == "section_points":
            words.append("2n")
        elif value != base[name]:
            letter = {"section_degree": "N", "degree": "p", "order": "K"}[name]
            words.append(f"{letter}{value - base[name]:+d}".replace("-", "−"))
    return ", ".join(words)


def _words(scene: Any, model: Any, base: Mapping[str, int], changed: Mapping[str, int]) -> tuple[str, ...]:
    """Return options of the command line: of a file the spaces of its rods, with the short elements that they have."""
    if model is not None and scene.content is not None:
        spaces = [_changed(body.space, changed, base.get("elements")) for body in model.bodies]
        return "--spaces", json.dumps(scene.on(spaces).spaces)
    names = {field.name for field in dataclasses.fields(scene)}
    words = []
    for name, value in (dict(base) | dict(changed)).items():
        # A spring counts its elements by the turn.
        if name == "elements" and name not in names:
            name, value = "elements_per_turn", scene.per_turn * value // scene.rod().axis.elements
        # The functions of control points of a section that are its rod's own.
        if name in names:
            words += [f"--{name.replace('_', '-')}", str(value)]
    return tuple(words)


def _changed(space: Any, changed: Mapping[str, int], elements: int | None) -> Any:
    """Return a space with other numbers: twice as many elements are all of its own, cut in two."""
    more: dict[str, Any] = dict(changed)
    if elements is not None and more.get("elements", 0) > elements:
        more |= choice.halved(space)
    rule = "auto" if "quadrature" in space.chosen else space.quadrature
    return dataclasses.replace(space, quadrature=rule, **more)
