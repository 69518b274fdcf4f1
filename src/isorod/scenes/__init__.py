"""Scenes: ready models with parameters, one a file that bears the scene's name.

A scene is a frozen dataclass (`isorod.errors.Checked`) of that name with a capital letter whose fields (made with
`option`) become command line options. It has a class attribute ``analysis`` (``"statics"``, ``"modal"``,
``"dynamics"`` or ``"geometry"``), ``rod()``, and for an analysis ``model()`` and ``measure(solution)``; for dynamics
also ``settings()``, the keyword arguments of `isorod.dynamics.solve`. Its class attribute ``units`` says, in words,
the unit of each number that is the answer, by its name in `measure` or in the solution's record, the most wanted
first. A scene whose element can be chosen is a `Preset`. A scene with a choice of analyses lists them in a class
attribute ``analyses``, the default first, and has ``analysis`` as a property.
"""

import dataclasses
from collections.abc import Mapping
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, ClassVar

from isorod.errors import Checked, InputError

# Names on the command line: those of the files here.  Each is imported only when it is asked for.
SCENES = tuple(sorted(module.name for module in iter_modules(__path__)))


# Those of a scene that is geometry only.
GEOMETRY_UNITS = {
    "volume": "(cube of the unit that lengths are in)",
    "smallest_jacobian": "(of the map from disk and axis; positive: no fold)",
    "control_points": "",
}


def option(default: Any, text: str) -> Any:
    """Return a dataclass field that is a command line option; ``text`` says what it is and in which unit."""
    return dataclasses.field(default=default, metadata={"help": text})


class Preset(Checked):
    """A scene with a field ``preset``, which says what fields of the element are that are not given."""

    PAPER: ClassVar[Mapping[str, Any]]
    """The paper's element; its axis is as smooth as its degree allows where no continuity is given."""
    SUITS: ClassVar[Mapping[str, Any]] = {}
    """What is taken without a preset where the rod's shape does not choose it."""

    preset: str | None

    @property
    def suits(self) -> Mapping[str, Any]:
        """What is taken without a preset: ``SUITS``, where the other fields do not say otherwise."""
        return self.SUITS

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.preset not in (None, "paper"):
            raise InputError(f"preset: got {self.preset!r}, need 'paper', or none for what suits the rod")
        polynomials = getattr(self, "section_degree", None) is not None
        for name, value in (self.PAPER if self.preset else self.suits).items():
            if getattr(self, name) is None and not (polynomials and name == "order"):
                object.__setattr__(self, name, value)
        if self.preset and getattr(self, "continuity", 0) is None:
            object.__setattr__(self, "continuity", getattr(self, "degree", 1) - 1)


def preset(text: str) -> Any:
    """Return the field ``preset``; ``text`` says what the paper's element is."""
    return option(None, f"paper: {text}, in what is not given (what suits the rod)")


def analyses(scene_type: Any) -> tuple[str, ...]:
    """Return the analyses a scene class offers, the default first."""
    return tuple(getattr(scene_type, "analyses", None) or (scene_type.analysis,))


def find(name: str) -> Any:
    """Return the scene class of that name, or raise `InputError` with the names there are."""
    if name not in SCENES:
        raise InputError(f"scene {name!r} is not known; there are: {', '.join(SCENES)}; a file's name ends in .toml")
    return getattr(import_module(f"{__name__}.{name}"), name.capitalize())
