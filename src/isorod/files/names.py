"""The names in a scene file: what they stand for, and which of them numbers in messages stand for."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from isorod.errors import InputError, SolveError
from isorod.files.document import Place
from isorod.files.form import Call, Name
from isorod.files.rod import RodPlan
from isorod.files.solid import SolidPlan
from isorod.files.values import Kind


@dataclass(frozen=True)
class Names:
    """What of a file has names, in the order in which analyses number it."""

    rods: Mapping[str, RodPlan]
    solids: Mapping[str, SolidPlan]
    supports: Mapping[str, Call]
    loads: Mapping[str, Call]
    obstacles: Mapping[str, Call]
    contacts: Mapping[str, Call]
    ties: Mapping[str, Call]
    # The names of the copies of a rod, by its own, which contacts may name.
    copies: Mapping[str, Sequence[str]]

    def of(self, one: Call) -> dict[str, Any]:
        """Return what the names among the arguments of a call stand for; the only rod need not be named."""
        found = {}
        for parameter in one.form.parameters.values():
            if not isinstance(parameter.kind, Kind) or not parameter.kind.name:
                continue
            said = one.arguments.get(parameter.name)
            if isinstance(said, Name):
                found[parameter.name] = said.among(self._known(parameter.kind.name))
            elif len(self.rods) > 1 and parameter.kind.name == "rod":
                raise one.place.error(f"rod is missing: which of {', '.join(self.rods)}?")
        return found

    def _known(self, kind: str) -> Mapping[str, Any]:
        """Return what names of a kind stand for."""
        rods: dict[str, Any] = {name: k for k, name in enumerate(self.rods)}
        if kind == "surface":
            # Loads what models are made of.
            from isorod.files.ties import surfaces

            return surfaces(rods, {name: [*plan.grid.groups] for name, plan in self.solids.items()})
        several = {name: tuple(rods[one] for one in same) for name, same in self.copies.items()}
        if kind == "rod, obstacle or solid":
            known = self._known("surface") if self.solids else {}
            facets = {name: one for name, one in known.items() if name.partition(".")[0] in self.solids}
            return rods | several | dict(self.obstacles) | facets
        if kind == "rod":
            return rods | several
        if kind == "obstacle":
            # The contacts in which it is.
            seconds = [getattr(one.arguments.get("second"), "name", None) for one in self.contacts.values()]
            known = {name: tuple(k for k, one in enumerate(seconds) if one == name) for name in self.obstacles}
            return {name: those for name, those in known.items() if those}
        return {name: k for k, name in enumerate(self.numbered[kind])}

    def check(self, top: Place) -> None:
        """Raise `InputError` if something is named that is not there, or not specified."""
        for group in (self.supports, self.loads, self.contacts, self.ties):
            for one in group.values():
                self.of(one)
        for kind, several in (("obstacle", self.obstacles), ("solid", self.solids)):
            both = next((name for name in several if name in self.rods), None)
            if both is not None:
                raise (top / kind / both).error("a rod has this name; choose another")

    def touching(self) -> set[str]:
        """Return the names of what touches."""
        said = [one.arguments.get(key) for one in self.contacts.values() for key in ("first", "second")]
        named = [one.name for one in said if isinstance(one, Name)]
        return {name for one in named for name in self.copies.get(one, [one])}

    def tied(self, rod: int) -> list[float]:
        """Return the lengths along a rod, by its number, at which ties of a part of it begin and end."""
        own = [one for one in self.ties.values() if getattr(self.of(one)["slave"], "body", None) == rod]
        return [length for one in own for length in one.arguments.get("along") or ()]

    def landed(self, rod: int) -> list[float]:
        """Return the axis parameters of a rod, by its number, where ends of others are tied to its lateral surface."""
        if not self.ties or len(self.rods) < 2:
            return []
        # Loads what models are made of.
        from isorod.files.ties import landed

        pairs = [(named["slave"], named["master"]) for named in map(self.of, self.ties.values())]
        return landed(rod, pairs, [plan.rod for plan in self.rods.values()])

    def bonded(self, rod: int) -> bool:
        """Return whether the lateral surface of a rod, by its number, is tied to a finite element body."""
        if not (self.ties and self.solids):
            return False
        # Loads what models are made of.
        from isorod.files.ties import Facets
        from isorod.model.tie import LateralSurface

        both = [[self.of(one)[side] for side in ("slave", "master")] for one in self.ties.values()]
        return any(
            any(isinstance(one, LateralSurface) and one.body == rod for one in pair)
            and any(isinstance(one, Facets) for one in pair)
            for pair in both
        )

    @property
    def numbered(self) -> dict[str, Mapping[str, Any]]:
        """What analyses know by their numbers."""
        return {
            "support": self.supports,
            "load": self.loads,
            "contact": self.contacts,
            "tie": self.ties,
            "body": self.rods,
            "solid": self.solids,
        }

    def named(self, text: str) -> str:
        """Return a text with these names in the place of numbers."""

        def name(match: re.Match[str]) -> str:
            names = [*self.numbered[match[1]]]
            k = int(match[2])
            if k < len(names):
                return f"{match[1].replace('body', 'rod')} {names[k]}"
            # The weight of each rod comes behind loads that have names.
            return "gravity" if match[1] == "load" else match[0]

        return re.sub(r"\b(support|load|contact|tie|body|solid) (\d+)\b", name, text)

    def located(self, problem: InputError | SolveError, at: Place, keys: Mapping[str, Place]) -> Exception:
        """Return an error of the model or its analysis as one of the file: of what it names, or of a place."""
        message = str(problem)
        if message.startswith(f"{at.document.name}:"):
            return type(problem)(self.named(message))
        first = re.match(r"(support|load|contact|tie) (\d+): ", message)
        several = [*self.numbered[first[1]].values()] if first else []
        if first and int(first[2]) < len(several):
            one = several[int(first[2])]
            return type(problem)(one.place.about(self.named(message[first.end() :]), one.keys))
        return type(problem)(at.about(self.named(message), keys))
