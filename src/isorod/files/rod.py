"""A rod of a scene file: curve, section, laws and space."""

import json
import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from isorod import choices
from isorod.arrays import Array
from isorod.files import schema
from isorod.files.data import Points
from isorod.files.document import Place
from isorod.files.form import Call, call, choice

if TYPE_CHECKING:
    from isorod.files.copies import Motion
    from isorod.geometry.rod import Rod
    from isorod.material import Material
    from isorod.model.body import Body
    from isorod.space.closer import Patch

# Elements of a curve at which stiffness along it is asked for, at most, and the point of the section there.
_LOOKS, _OFF_CENTRE = 16, np.array([[0.5, 0.0]])

# Keys of what it is made of in space.
_SHAPE = ("curve", "section", "space", "tree", *schema.SWEEP.parameters, *schema.RINGS.parameters)

# Points round the section, innermost and outermost, at which temperatures are looked at.
_LOOKED = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])

# Keys of thermal expansion, known without what it loads.
_WARM = ("expansion", "temperature", "temperature_history", "stiffness")

# Rows of a table of temperatures up to which elements end at them.
_FEW = 16

# Steps from a length between two samples of the centre line to its axis parameter.
_NEWTON = 4

# Within this fraction of the rod from an end a place counts as the end (`isorod.space.trace`).
_ROUNDED = 1e-6


class Use(NamedTuple):
    """What a scene does with a rod, by which its space is chosen where nothing is given.

    Attributes
    ----------
    touching
        Whether it is in contact, in statics or modes.
    surface
        Whether section functions have to be those of control points on the surface.
    stressed
        Whether stresses are requested.
    explicit
        Whether steps in time are explicit, so that the shortest element sets their length.
    buckles
        Whether load factors of buckling are requested.
    loaded
        Axis parameters of sections on which loads act.
    tied
        Lengths along it at which a tie of its lateral surface begins or ends.
    bonded
        Whether its lateral surface is tied to a finite element body.
    pressed
        Whether pressures act on its surface.
    angle
        By which supports turn it in all, radians.
    patches
        Where something small presses on it.
    """

    touching: bool
    surface: bool
    stressed: bool
    buckles: bool
    explicit: bool
    loaded: list[float]
    tied: list[float]
    bonded: bool
    pressed: bool
    angle: float
    patches: "Sequence[Patch]"


class RodPlan:
    """What a file says of a rod, or of one of several copies, which is where a motion puts it.

    Raises
    ------
    InputError
        If something is not known, missing, or not of its kind.
    """

    KEYS = ("curve", "section", "law", "space", "copy", "tree")

    def __init__(self, place: Place, table: Mapping[str, Any], motion: "Motion | None" = None) -> None:
        self.place, self._motion = place, motion
        self._built: Rod | None = None
        self._shape = _shape(place, table, motion)
        sweep = {key: one for key, one in table.items() if key in schema.SWEEP.parameters}
        self._sweep = call(place, schema.SWEEP, sweep)
        rings = {key: one for key, one in table.items() if key in schema.RINGS.parameters}
        self._rings = call(place, schema.RINGS, rings) if rings else None
        warm = {key: one for key, one in table.items() if key in _WARM}
        self._warm = call(place, schema.THERMAL, warm) if warm else None
        rest = {key: one for key, one in table.items() if key not in (*self.KEYS, *sweep, *rings, *warm)}
        self._body: Call | None = None
        if rest:
            # Geometry alone does without.
            forms = schema.SWEEP, schema.RINGS, schema.THERMAL, schema.BODY
            known = (*self.KEYS, *(key for form in forms for key in form.parameters))
            for key in rest:
                if key not in known:
                    raise (place / key).unknown_key(known)
            self._body = call(place, schema.BODY, rest)
        if "curve" not in table:
            raise place.error(f"curve is missing: one of {', '.join(schema.CURVES)}; or a tree")
        self.curve = choice(place / "curve", schema.CURVES, table["curve"])
        radius = next((one.radius for one in self.curve.arguments.values() if isinstance(one, Points)), None)
        if radius is not None:
            if "scale" in table:
                raise (place / "scale").error("given twice: the curve's file has a radius")
            self._sweep.arguments["scale"] = radius
        self.section = self._section(table, radius is not None)
        self.laws = self._laws(table)
        self.space = call(place / "space", schema.SPACE, (place / "space").table(table.get("space", {})))
        # Whether its space may be refined at small contact patches (`isorod.space.closer`).
        self.free = not self.space.arguments and len(self.laws) == 1 and self._rings is None

    def _section(self, table: Mapping[str, Any], scaled: bool) -> Call:
        """Return the section: of a curve with radii the unit circle where it is not given."""
        if "section" in table or scaled:
            return choice(self.place / "section", schema.SECTIONS, table.get("section", "circle"))
        raise self.place.error(f"section is missing: one of {', '.join(schema.SECTIONS)}")

    def _laws(self, table: Mapping[str, Any]) -> list[Call]:
        place, value = self.place / "law", table.get("law", [])
        if not isinstance(value, list):
            return [choice(place, schema.LAWS, value)]
        if "law" in table and not value:
            raise place.error("no law is in the list")
        return [choice(place / k, schema.LAWS, one) for k, one in enumerate(value)]

    def _expanded(self, rod: "Rod", laws: "list[Material]") -> "list[Material]":
        """Return laws with the thermal expansion that the file gives each or all of them."""
        if self._warm is None:
            return laws
        from isorod.material.places import Places

        expansion = self._warm.arguments["expansion"]
        # Of one law the numbers of a list are those along its axes.
        each = expansion if isinstance(expansion, list) and len(laws) > 1 else [expansion] * len(laws)
        if len(each) != len(laws):
            raise (self.place / "expansion").error(
                f"got {len(each)} numbers for {len(laws)} laws, need one, or one for each"
            )
        expanded = [self._warm.make(law=law, expansion=one) for law, one in zip(laws, each, strict=True)]
        breaks = rod.axis.breaks
        points = np.concatenate([rod.rings[0] * _LOOKED, _LOOKED])
        places = Places(rod, np.linspace(breaks[0], breaks[-1], _LOOKS + 1)[:, None], points)
        with self.place.locating(self._warm.keys):
            for one in expanded:
                one.placed(places)
        return expanded

    def rod(self) -> "Rod":
        """Return the rod as first built, checked for folds; warnings name the rod."""
        if self._built is None:
            self._built = choices.same(self._shape, self._build)
        return self._built

    def _build(self) -> "Rod":
        with warnings.catch_warnings(record=True) as recorded:
            warnings.simplefilter("always")
            line, outline = self.curve.make(), self.section.make()
            with self.place.locating():
                rod: Rod = self._sweep.make(self=line, section=outline)
                rod = rod if self._motion is None else self._motion(rod)
                if not choices.near():
                    rod.check()
        for one in recorded:
            warnings.warn(f"{self.place}: {one.message}", one.category, stacklevel=2)
        return rod if self._rings is None else self._rings.make(self=rod)

    @property
    def _pieces(self) -> bool:
        """Whether the curve is a chain of segments, to which laws in a list belong."""
        return self.curve.form is schema.CURVES["chain"]

    def _joints(self, rod: "Rod") -> Array:
        """Return the axis parameters between which laws in a list hold: ends of pieces, or of elements."""
        joints: Array = self.curve.make().stations if self._pieces else rod.axis.breaks
        return joints

    def _along_axis(self, rod: "Rod", laws: "list[Material]") -> "list[Material]":
        """Return laws, one for each piece or element of the curve, as those of the rod's elements; of rings as is."""
        joints, rings = self._joints(rod), len(rod.rings) - 1
        places = len(joints) - 1 if rings == 1 else rings
        if len(laws) != places:
            what = "pieces" if self._pieces else "elements"
            each = f"the {places} {what} of the curve" if rings == 1 else f"the {rings} rings of the section"
            raise (self.place / "law").error(f"got {len(laws)} laws for {each}, need one, or one for each")
        return [laws[k] for k in np.searchsorted(joints, rod.axis.within([0.5]).ravel()) - 1] if rings == 1 else laws

    def _warmed(self, rod: "Rod") -> list[float]:
        """Return the axis parameters at which a temperature along the rod has another slope, if they are few."""
        lengths = getattr(self._warm and self._warm.arguments["temperature"], "lengths", ())
        return _kinks(rod, lengths[1:-1]) if len(lengths) <= _FEW else []

    def _along(self, rod: "Rod", use: Use, reach: float) -> dict[str, Any]:
        """Return keywords of a space's axis that are not given, where more is known than the rod's shape.

        It touches others, supports turn it, loads act on sections, a part of it is tied, it has fibres or is under
        pressure, or laws differ between elements of the curve, so that slopes jump there.
        """
        from isorod.space import choice as chosen

        given, kinks = self.space.arguments, _kinks(rod, use.tied)
        elements, degree, continuity = (given.get(key) for key in ("elements", "degree", "continuity"))
        keywords: dict[str, Any] = {}
        if use.touching:
            keywords = chosen.touching(rod, elements, degree, continuity, use.angle)
        elif elements is None:
            if use.angle:
                keywords = chosen.turned(rod, use.angle, degree, continuity)
            first, last = rod.axis.breaks[[0, -1]]
            places = [u for u in (*use.loaded, *kinks, *self._warmed(rod)) if first < u < last and not rod.closed]
            if len(self.laws) > 1 and len(rod.rings) == 2:
                places += self._joints(rod)[1:-1].tolist()
                # Where segments of a chain meet slopes may jump anyway.
                keywords |= {} if self._pieces else {"continuity": 0}
            layer = chosen.layer(rod, reach, use.pressed) if use.stressed else chosen.LAYER
            if places or (layer != chosen.LAYER and not rod.closed):
                keywords["knots"] = chosen.boundary_layers(rod, degree, places, use.angle, layer)
        if use.explicit:
            keywords["knots"] = ()
        if kinks:
            # At knots of the curve, too: what is tied ends there.
            keywords["knots"] = tuple(sorted([*{*keywords.get("knots", ())}.difference(kinks), *2 * kinks]))
        return {name: value for name, value in keywords.items() if name not in given}

    @property
    def _gives_section(self) -> bool:
        """Whether section functions are given."""
        return bool({"order", "section_points", "section_degree"} & set(self.space.arguments))

    def _across(self, rod: "Rod", use: Use, reach: float) -> dict[str, int]:
        """Return section functions that suit the rod's use, if none are given and these are others than are chosen."""
        from isorod.space import choice as chosen

        if self._gives_section:
            return {}
        if use.surface and self._rings is None:
            return {"order": chosen.ORDER}
        if use.buckles:
            return chosen.buckling(rod)
        if not use.stressed:
            return {}
        section = chosen.stressed(rod, reach, use.pressed)
        return {} if section == chosen.section(rod) else section

    def body(self, use: Use) -> "Body":
        """Return the body."""
        if not self.laws:
            raise self.place.error(f"law is missing: one of {', '.join(schema.LAWS)}")
        own = rod = self.rod()
        laws = self._expanded(rod, [one.make() for one in self.laws])
        reach = _reach(rod, laws) if use.stressed else 0.0
        if len(self.laws) == 1 and not (use.surface or use.explicit or self._gives_section):
            from isorod.space import choice as chosen

            rim = choices.chosen(lambda: use.bonded or chosen.is_short(rod, reach))
            rod = choices.same((rod, "rim"), lambda: chosen.with_rim(own)) if rim else rod
        if len(laws) > 1:
            laws = self._along_axis(rod, laws)
        if use.patches:
            from isorod.space.closer import closer

            space = closer(rod, use.patches)
        else:
            # Both are choices, and hold for models beside.
            marks = *rod.axis.breaks, *use.loaded
            before, suited = choices.chosen(
                lambda: (marks, self._along(rod, use, reach) | self._across(rod, use, reach))
            )
            if suited.get("knots"):
                suited = suited | {"knots": _moved(suited["knots"], before, marks)}
            space = choices.same((rod, "space", suited.get("knots")), lambda: self.space.make(rod=rod, **suited))
        material = laws[0] if len(laws) == 1 else laws
        form = self._body or call(self.place, schema.BODY, {})
        body: Body = form.make(space=space, material=material)
        return body


def _shape(place: Place, table: Mapping[str, Any], motion: "Motion | None") -> Any:
    """Return what a rod is built of, to compare; nothing is like what is no plain table."""
    try:
        text = json.dumps({key: one for key, one in table.items() if key in _SHAPE})
    except TypeError:
        return object()
    return str(place), text, *(() if motion is None else map(bytes, motion))


def _reach(rod: "Rod", laws: Sequence[Any]) -> float:
    """Return how far what is done to an end reaches in fibres, in radii: 0 where no law has any."""
    from isorod.material.law import reach
    from isorod.material.places import Places
    from isorod.material.thermal import bare

    breaks = rod.axis.breaks[:: -(-rod.axis.elements // _LOOKS)]
    places = Places(rod, 0.5 * (breaks[:-1] + breaks[1:])[:, None], _OFF_CENTRE)
    return max((reach(bare(law), places) for law in laws if law.families), default=0.0)


def _moved(knots: Sequence[float], before: Sequence[float], after: Sequence[float]) -> tuple[float, ...]:
    """Return knots where they are between breaks and sections with loads or supports, which a parameter has moved."""
    order = np.argsort(before, kind="stable")
    if np.array_equal(before, after) or (np.diff(np.array(after)[order]) < 0.0).any():
        return tuple(knots)
    return tuple(np.interp(knots, np.array(before)[order], np.array(after)[order]).tolist())


def _kinks(rod: "Rod", lengths: Sequence[float]) -> list[float]:
    """Return the axis parameters within a rod at lengths along its centre line."""
    length = rod.arc_length
    u = np.interp(lengths, length.length, length.u)
    for _ in range(_NEWTON):
        u -= (length(u) - lengths) / np.interp(u, length.u, length.speed)
    first, last = rod.axis.breaks[[0, -1]]
    rounding = _ROUNDED * (last - first)
    return sorted({float(one) for one in u if first + rounding < one < last - rounding})
