"""Scenes: ready models with parameters, one a file that bears the scene's name.

A ready scene is a frozen dataclass (`Scene`) of that name with a capital letter, whose fields (made with `option`)
become command line options. It has a class attribute ``analysis`` (``"statics"``, ``"modal"``, ``"dynamics"`` or
``"geometry"``), ``rod()`` or ``rods()``, and for an analysis ``model()`` and ``measure(solution)``; for dynamics
also ``settings()``. Its class attribute ``units`` says, in words, the unit of each number that is the answer, by its
name in `measure` or in the solution's record, the main one first. A scene whose element can be chosen is a `Preset`.
A scene with a choice of analyses lists them in a class attribute ``analyses``, the default first, and has ``analysis``
as a property.  The scene of a file (`isorod.files.scene`) is a `Scene` as well.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any, ClassVar, cast

from isorod import choices
from isorod.errors import Checked, InputError

if TYPE_CHECKING:
    from isorod.arrays import Array
    from isorod.geometry.rod import Rod
    from isorod.material.law import Material
    from isorod.model.model import Model
    from isorod.space.space import Space
    from isorod.statics.equilibrium import Equilibrium

# Names on the command line: those of the files here.  Each is imported only when it is asked for.
SCENES = tuple(sorted(module.name for module in iter_modules(__path__)))

# Fields that a space has as well.
_ELEMENT = ("order", "section_degree", "degree", "continuity", "quadrature")

# Those of a scene that is geometry only.
GEOMETRY_UNITS = {
    "volume": "(cube of the unit that lengths are in)",
    "smallest_jacobian": "(of the map from disk and axis; positive: no fold)",
    "control_points": "",
}


def option(default: Any, text: str, **more: Any) -> Any:
    """Return a dataclass field that is a command line option; ``text`` is its help, with the unit.

    ``more`` may have a ``flag`` in the place of the field's name, a ``metavar``, and in ``was`` the option's former
    name, which is taken with a warning; ``radians`` where that was an angle in radians, and degrees are taken now.
    """
    return dataclasses.field(default=default, metadata={"help": text, **more})


class Scene(Checked):
    """The protocol of scenes, which is all that commands ask; what is here is the same for all Python scenes.

    Attributes
    ----------
    name, title
        What it is called, and what it is in a line.
    stresses
        The names of those results that are stresses.
    along
        The names of those that each load step of statics has as well.
    load_steps
        Initial number of equal load steps of statics.
    content
        Content of the scene's file; None where there is none.
    cases, case
        The names of its load cases, and which of them it is; none and None where it has none.
    """

    name: Any = ""
    title: Any = ""
    stresses: Sequence[str] = ()
    along: Sequence[str] = ()
    content: Any = None
    cases: Sequence[str] = ()
    case: Any = None
    load_steps: ClassVar[int] = 1

    def __init_subclass__(cls) -> None:
        cls.name, cls.title = cls.__name__.lower(), (cls.__doc__ or "").strip().partition("\n")[0]

    @property
    def option_fields(self) -> "list[dataclasses.Field[Any]]":
        """The fields that are options of the command line."""
        return [field for field in _fields(self) if "help" in field.metadata]

    def with_options(self, **options: Any) -> Any:
        """Return the scene with options; those that are None stay as they are."""
        given = {name: value for name, value in options.items() if value is not None}
        return dataclasses.replace(cast(Any, self), **given) if given else self

    def settings(self) -> dict[str, Any]:
        """Return the keyword arguments of the analysis."""
        return {} if self.load_steps == 1 else {"load_steps": self.load_steps}

    def rod(self) -> "Rod":
        """Return the only rod, as first built."""
        raise NotImplementedError

    def rods(self) -> "Sequence[Rod]":
        """Return the rods as first built."""
        return [self.rod()]

    @property
    def options(self) -> dict[str, Any]:
        """What a record keeps of the scene."""
        return {"options": {field.name: getattr(self, field.name) for field in _fields(self)}}

    @property
    def _usual(self) -> Mapping[str, Any]:
        """What fields are that are not given, where these are not their defaults."""
        return {}

    @property
    def described(self) -> str:
        """Which options are not as they are by default, in words."""
        given = {field.name.replace("_", " "): getattr(self, field.name) for field in _fields(self)}
        usual = (self._usual.get(field.name, field.default) for field in _fields(self))
        changed = [
            f"{name} {value:.12g}" if isinstance(value, float) else f"{name} {value}"
            for (name, value), default in zip(given.items(), usual, strict=True)
            if value != default
        ]
        return ", ".join(changed) or "options as they are by default"

    def space_of(self, rod: "Rod", **changed: Any) -> "Space":
        """Return the space of a rod that does not fold, by the scene's fields of the names of its parameters.

        A scene without ``continuity`` has splines as smooth as their degree allows; ``changed`` takes the place of
        fields.
        """
        from isorod.space.space import Space

        if not choices.near():
            rod.check()
        names = {field.name for field in _fields(self)} & {"elements", *_ELEMENT}
        given = {name: getattr(self, name) for name in names} | changed
        if "continuity" not in given:
            given["continuity"] = given["degree"] - 1
        return choices.same((rod, *sorted(given.items())), lambda: Space(rod, **given))

    def space_in_turns(self, rod: "Rod", own: int, each: int | None) -> "Space":
        """Return `space_of` a helix that is built of ``own`` elements a turn, cut into ``each`` if that is given."""
        if each is not None and (each < own or each % own):
            raise InputError(f"elements a turn: got {each}, need a multiple of {own}")
        return self.space_of(rod, elements=None if each is None else rod.axis.elements * each // own)

    def rod_names(self) -> list[str]:
        """Return the names of the rods, where they have names."""
        return []

    def solid_names(self) -> list[str]:
        """Return the names of the finite element bodies, each with its mesh and the groups of that."""
        return []

    @property
    def names(self) -> dict[str, list[str]]:
        """What has names in the order in which records have it: rods, supports, loads, contacts, ties, solids."""
        return {}

    def named(self, text: str) -> str:
        """Return a text with the scene's own names in the place of numbers."""
        return text

    def locating(self) -> AbstractContextManager[None]:
        """Add the place in the scene to errors of the model and its analysis."""
        return nullcontext()

    def refined_at_contact(self, solution: Any) -> Any:
        """Return the same scene on spaces that resolve the patches of a solution's contacts; None where they do."""
        return None

    def on(self, spaces: "Sequence[Space]") -> Any:
        """Return the scene on these spaces of its rods; a scene of a class has the same for all of them."""
        space = spaces[0]
        names = {field.name for field in _fields(self)}
        changed = {name: getattr(space, name) for name in _ELEMENT if name in names}
        if space.section_degree is None:
            changed["section_points"] = space.points_around
        scene, elements = cast(Any, self), cast(int, space.elements)
        (along,) = names & {"elements", "elements_per_turn", "parts"}
        if along == "elements":
            changed[along] = elements
        elif getattr(scene, along) is None:
            changed[along] = scene.per_turn * elements // scene.rod().axis.elements
        else:
            changed[along] = getattr(scene, along) * elements // scene.model().bodies[0].space.elements
        return dataclasses.replace(scene, **changed)


def _fields(scene: Scene) -> tuple[dataclasses.Field[Any], ...]:
    return dataclasses.fields(cast(Any, scene))


@dataclasses.dataclass(frozen=True)
class Wound(Scene):
    """A scene of round wire in coils, both end faces held, that are pressed together over time."""

    coils: float = option(2, "number of turns, not necessarily whole")
    coil_radius: float = option(10.0, "radius of the helix, to the wire's centre [length]")
    pitch: float = option(11.079, "rise per turn [length]")
    wire_radius: float = option(1.0, "radius of the wire [length]")
    E: float = option(210e3, "Young's modulus [force/area]")
    nu: float = option(0.3, "Poisson's ratio")
    elements_per_turn: int | None = option(None, "elements a turn, a multiple of 8 (chosen)")
    section_degree: int | None = option(None, "polynomials of this degree across the section, 1 to 8 (chosen)")
    degree: int | None = option(None, "degree along the axis, 4 to 6 (5)")
    continuity: int | None = option(None, "continuity at inserted knots, below degree (degree - 3)")
    quadrature: str | None = option(None, "quadrature rule: auto, full, paper, RxS or RxSxT such as 2x1x4 (chosen)")

    @property
    def per_turn(self) -> int:
        """Elements a turn of the wire as first built."""
        from isorod.geometry.coils import HELIX_ELEMENTS

        return HELIX_ELEMENTS

    @property
    def shear(self) -> float:
        """Shear modulus [force/area]."""
        return self.E / (2.0 + 2.0 * self.nu)

    def rod(self) -> "Rod":
        """Return the wire as first built, a quartic spline that climbs evenly."""
        from isorod.geometry import section
        from isorod.geometry.coils import helix

        return helix(self.coil_radius, self.pitch, self.coils).sweep(section.circle(8, self.wire_radius))

    def pressed(self, law: "Material", travel: float, history: Sequence[Sequence[float]]) -> "Model":
        """Return the model of a law, start clamped, end clamped and moved down by a travel times a table."""
        import isorod

        space = self.space_in_turns(self.rod(), self.per_turn, self.elements_per_turn)
        moved = isorod.Support.end(space, "end", displacement=(0.0, 0.0, -travel), history=history)
        return isorod.Model([isorod.Body(space, law)], [isorod.Support.end(space, "start"), moved])

    def load_history(self, solution: "Equilibrium") -> tuple["Array", "Array", "Array"]:
        """Return times, travels over the whole one, and forces at each load step."""
        import numpy as np

        model, factors = solution.model, [one.factor for one in solution.path]
        assert model.times is not None, "solved with an end_time"
        times = [model.times.time(one) for one in factors]
        fractions = [model.amplitude(model.motions[1].clock.table, one) for one in factors]
        return np.array(times), np.array(fractions), np.array([-one.reactions[1, 2] for one in solution.path])


class Preset(Scene):
    """A scene with a field ``preset``, which sets the fields of the element that are not given."""

    PAPER: ClassVar[Mapping[str, Any]]
    """The paper's element; its axis is as smooth as its degree allows where no continuity is given."""
    SUITS: ClassVar[Mapping[str, Any]] = {}
    """What is taken without a preset where the rod's shape does not choose it."""

    preset: str | None

    def with_options(self, **options: Any) -> Any:
        """Return the scene with options in the place of all, so that what was chosen does not count as given."""
        return type(self)(**{name: value for name, value in options.items() if value is not None})

    @property
    def suits(self) -> Mapping[str, Any]:
        """What is taken without a preset: ``SUITS``, where the other fields do not say otherwise."""
        return self.SUITS

    @property
    def _usual(self) -> Mapping[str, Any]:
        return {} if self.preset else self.suits

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.preset not in (None, "paper"):
            raise InputError(f"preset: got {self.preset!r}, need 'paper', or none for what suits the rod")
        polynomials = getattr(self, "section_degree", None) is not None
        for name, value in (self.PAPER if self.preset else self.suits).items():
            if getattr(self, name) is None and not (polynomials and name == "order"):
                self._set(**{name: value})
        if self.preset and getattr(self, "continuity", 0) is None:
            self._set(continuity=getattr(self, "degree", 1) - 1)


def preset(text: str) -> Any:
    """Return the field ``preset``; ``text`` describes the paper's element."""
    return option(None, f"paper: {text}, in what is not given (what suits the rod)")


def analyses(scene_type: Any) -> tuple[str, ...]:
    """Return the analyses a scene class offers, the default first."""
    return tuple(getattr(scene_type, "analyses", None) or (scene_type.analysis,))


def find(name: str) -> Any:
    """Return the scene class of that name, or raise `InputError` with the names there are."""
    if name not in SCENES:
        raise InputError(f"scene {name!r} is not known; there are: {', '.join(SCENES)}; a file's name ends in .toml")
    return getattr(import_module(f"{__name__}.{name}"), name.capitalize())
