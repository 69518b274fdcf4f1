"""A scene that a file describes: to the command what a scene class is (`isorod.scenes`)."""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import Field, dataclass, field, replace
from functools import partial
from math import dist, inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isorod.errors import InputError, SolveError
from isorod.files import cases, schema, steps, vibrations
from isorod.files.copies import Copies, placed
from isorod.files.document import KEYS, Document, Place, as_json, shown
from isorod.files.form import Call, Form, call, choice
from isorod.files.names import Names
from isorod.files.rod import RodPlan, Use
from isorod.files.solid import OfBody, SolidPlan
from isorod.scenes import GEOMETRY_UNITS, Scene, option

if TYPE_CHECKING:
    from isorod.geometry.rod import Rod
    from isorod.model.model import Model
    from isorod.space.closer import Patch
    from isorod.space.space import Space

# Options of all spaces.
_SPACE = ("elements", "order", "section_points", "section_degree", "degree", "continuity", "quadrature")

_SET = "override a value of the file: rod.NAME.law.NeoHookean.nu=0.3, support.NAME.displacement.2=0.5 (may be repeated)"

_FORCE = "(of force: the unit of E times that of length squared)"


def _space(text: str) -> Any:
    return option(None, f"{text}, of every rod (as in the file)")


@dataclass(eq=False)
class FileScene(Scene):
    """The scene of a TOML file.

    Parameters
    ----------
    path
        The file.
    elements, order, section_points, section_degree, degree, continuity, quadrature
        Options of the space of every rod (`isorod.space.space.Space`), in the place of the file's; where not
        given, the file's, if these are the same for all rods.
    spaces
        All options of the space of a rod in the place of those, by its name (`on`).
    patches
        Small contact patches on rods, by their number (`refined_at_contact`).
    changes
        Values in the place of the file's own (`isorod.files.changes`).
    case
        The load case (`isorod.files.cases`), of a file that has several.

    Attributes
    ----------
    name
        Of the file, without its folder and ending.
    title
        The file's title.
    content
        The file's content, as `tomllib` reads it, with the options of spaces.
    data
        SHA-256 sum of each data file, by its name in the scene's file.
    cases
        The names of the load cases.
    analysis
        ``"statics"``, ``"modal"``, ``"buckling"``, ``"harmonic"``, ``"random"``, ``"dynamics"`` or ``"geometry"``.
    units
        Of each number that is the answer, in words.
    stresses
        The names of those that are stresses, to which an estimate of the error of works does not apply.

    Raises
    ------
    InputError
        If it cannot be read, or something in it is not known, missing, or not of its kind: with file, line and place.
    """

    path: str
    elements: int | None = _space("elements along the axis")
    order: int | None = _space("polyharmonic order K of the section functions, 1 to 6")
    section_points: int | None = _space("control points round the section")
    section_degree: int | None = _space("polynomials of this degree across the section, 1 to 8")
    degree: int | None = _space("degree along the axis, up to 6")
    continuity: int | None = _space("continuity at inserted knots, 0 to degree - 1")
    quadrature: str | None = _space("quadrature rule: auto, full, paper, RxS or RxSxT such as 2x1x4")
    spaces: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    patches: "Mapping[int, Sequence[Patch]]" = field(default_factory=dict)
    changes: Sequence[str] = option((), _SET, flag="--set", metavar="PATH=VALUE")
    case: str | None = option(None, "one of the file's load cases, alone")

    def __post_init__(self) -> None:
        document = Document(self.path)
        self.cases = cases.put(document, self.case, self.changes)
        steps.put(document)
        self.name, self.content, self.data = Path(self.path).stem, document.content, document.read
        self._top = top = document.top
        for key in self.content:
            if key not in KEYS:
                raise (top / key).unknown_key(KEYS)
        self.title = self.content.get("title", self.name)
        if not isinstance(self.title, str):
            raise (top / "title").error(f"got {shown(self.title)}, need a text")
        if "analysis" not in self.content:
            raise top.error(f"analysis is missing: analysis = {' or '.join(map(repr, schema.ANALYSES))}")
        self.analysis, self._explicit = schema.analysis(top / "analysis", self.content["analysis"])
        self.plans, copies = self._rods()
        self._names = Names(
            self.plans,
            {name: SolidPlan(place, table) for name, place, table in self._named("solid", SolidPlan.KEYS)},
            self._choices("support", schema.SUPPORTS),
            self._choices("load", schema.LOADS),
            self._choices("obstacle", schema.OBSTACLES),
            {name: call(place, schema.CONTACTS, table) for name, place, table in self._named("contact")},
            self._copied("tie", {name: call(place, schema.TIES, table) for name, place, table in self._named("tie")})
            | self._forks,
            copies,
        )
        self._spin = None
        if "spin" in self.content:
            self._spin = call(top / "spin", schema.SPIN, (top / "spin").table(self.content["spin"]))
        self._gravity = None
        if "gravity" in self.content:
            self._gravity = call(top / "gravity", schema.GRAVITY, (top / "gravity").table(self.content["gravity"]))
            for plan in self._names.solids.values():
                plan.gravity = self._gravity.arguments
        self._names.check(top)
        self.units: dict[str, str] = {}
        self.along: list[str] = []
        self.stresses: list[str] = []
        self._measures = dict(self._asked())

    @property
    def option_fields(self) -> list[Field[Any]]:
        """The fields that are options: of geometry alone none that spaces have."""
        left = {*(_SPACE if self.analysis == "geometry" else ()), *(() if self.cases else ("case",))}
        return [one for one in super().option_fields if one.name not in left]

    def _rods(self) -> tuple[dict[str, RodPlan], dict[str, list[str]]]:
        """Return the rods, and the names of the copies of one by its own."""
        copies = placed(self._named("rod", RodPlan.KEYS))
        if not copies.places:
            raise self._top.error("no rod is in it: [rod.NAME]")
        own = self.content["rod"]
        self._copied = Copies(copies.names, next(iter(own)) if len(own) == 1 else None).of
        self._set_spaces(copies.tables)
        self._forks = {name: call(copies.places[name], schema.TIES, table) for name, table in copies.ties.items()}
        plans = {
            name: RodPlan(place, copies.tables[name], copies.motions.get(name)) for name, place in copies.places.items()
        }
        return plans, copies.names

    def _set_spaces(self, named: Mapping[str, dict[str, Any]]) -> None:
        """Make the options for the spaces of all rods and the file's own spaces agree."""
        rods = [*named.values()]
        for name in _SPACE:
            given = getattr(self, name)
            for table in rods if given is not None else ():
                if isinstance(space := table.setdefault("space", {}), dict):
                    space[name] = given
        for rod, space in self.spaces.items():
            own = dict(space)
            named[rod] |= {"rings": own.pop("rings")} if "rings" in own else {}
            named[rod]["space"] = own
        for name in _SPACE:
            spaces = [table.get("space", {}) for table in rods]
            values = [space.get(name) for space in spaces if isinstance(space, dict)]
            setattr(self, name, values[0] if values and all(one == values[0] for one in values) else None)

    def _use(self, number: int) -> Use:
        """Return what the scene does with a rod."""
        supports, loads = (
            [one for one in group.values() if self._names.of(one).get("body", 0) == number]
            for group in (self._names.supports, self._names.loads)
        )
        turns = [one.arguments.get("turn", (0.0, 0.0, 0.0)) for one in supports]
        touching = [*self.plans][number] in self._names.touching()
        held = any(one.form is schema.SUPPORTS["patch"] for one in supports)
        places = (one.arguments.get("u", one.arguments.get("at")) for one in (*supports, *loads))
        return Use(
            # A motion seeks contact at each of many steps, the shorter the smaller the elements are.
            touching=touching and self.analysis in ("statics", "modal"),
            surface=touching or held,
            stressed=self.analysis in ("statics", *schema.SWINGING),
            buckles=self.analysis == "buckling",
            explicit=self._explicit,
            loaded=[*(float(u) for u in places if isinstance(u, float | int)), *self._names.landed(number)],
            tied=self._names.tied(number),
            bonded=self._names.bonded(number),
            pressed=any(one.form is schema.LOADS["pressure"] for one in loads),
            angle=max((dist(one, other) for one in turns for other in turns), default=0.0),
            patches=self.patches.get(number, ()),
        )

    def settings(self) -> dict[str, Any]:
        """Return the keyword arguments of the analysis."""
        # Loads the analysis, which starts PETSc.
        arguments = choice(self._top / "analysis", schema.ANALYSES, self.content["analysis"]).arguments
        return vibrations.settled(arguments, self._names.loads)

    def _named(self, kind: str, keys: tuple[str, ...] = ()) -> Iterator[tuple[str, Place, dict[str, Any]]]:
        """Yield name, place and table of each thing of a kind; ``keys`` are what it has, and no names."""
        place = self._top / kind
        several = self.content.get(kind, {})
        if not isinstance(several, dict):
            raise place.error(f"got {shown(several)}, need a table for each, with a name: [{kind}.NAME]")
        for name, table in several.items():
            if name in keys or not isinstance(table, dict):
                raise (place / name).error(f"it belongs to one {kind}, which has a name: [{kind}.NAME]")
            yield name, place / name, table

    def _choices(self, kind: str, words: Mapping[str, Form]) -> dict[str, Call]:
        return self._copied(kind, {name: choice(place, words, table) for name, place, table in self._named(kind)})

    def _asked(self) -> Iterator[tuple[str, Callable[..., Any]]]:
        """Yield what is measured, by its name, and note its unit."""
        kind = schema.SOLUTIONS.get(self.analysis, "none")
        fitting = {word: form for word, form in schema.MEASURES.items() if kind in str(form.solution)}
        place = self._top / "measure"
        if "measure" in self.content and not fitting:
            raise place.error(f"no measures in {self.analysis}: its results are reported without")
        for _, at, table in self._named("measure"):
            schema.refuse_unavailable(at, table, self.analysis, fitting)
        for name, asked in self._choices("measure", fitting).items():
            if name in schema.RESERVED:
                raise (place / name).error("a result has something else of this name; choose another")
            self.units[name] = asked.arguments.pop("unit", "")
            if self._explicit and asked.form in (schema.MEASURES["tie_force"], schema.MEASURES["tie_moment"]):
                raise asked.place.error('tie forces are not available in explicit steps; use integrator = "implicit"')
            if asked.form is schema.MEASURES["stress"]:
                self.stresses.append(name)
            if asked.form in (schema.MEASURES[word] for word in schema.ALONG):
                self.along.append(name)
            yield name, partial(asked.make, **self._names.of(asked))
        if self.analysis == "modal":
            self.units["frequencies"] = "(cycles per unit of time)"
            yield "frequencies", lambda solution: solution.frequencies
        elif self.analysis == "buckling":
            self.units["factors"] = "(times the loads and moved supports)"
            yield "factors", lambda solution: solution.factors
        elif self.analysis in schema.SWINGING and "measure" not in self.content:
            raise place.error("nothing is measured: [measure.NAME], as displacement = ROD")
        elif fitting and "measure" not in self.content:
            for k, name in enumerate(self._names.supports):
                self.units[f"reaction_{name}"] = _FORCE
                yield f"reaction_{name}", partial(schema.MEASURES["reaction"].function, support=k)
        if self.analysis == "geometry":
            self.units = GEOMETRY_UNITS

    def rods(self) -> "list[Rod]":
        """Return the rods as first built."""
        return [plan.rod() for plan in self.plans.values()]

    def rod_names(self) -> list[str]:
        """Return the names of the rods."""
        return [*self.plans]

    def solid_names(self) -> list[str]:
        """Return the names of the finite element bodies, each with its mesh and the groups of that."""
        return [f"{name}: {plan}" for name, plan in self._names.solids.items()]

    def bodies(self) -> list[OfBody]:
        """Return the file's tables of finite element bodies, in the order of the model's."""
        return [plan.of_body(name) for name, plan in self._names.solids.items()]

    @property
    def names(self) -> dict[str, list[str]]:
        """What has names in the order in which records have it."""
        names_by_kind = {kind.replace("body", "rod"): [*several] for kind, several in self._names.numbered.items()}
        return {f"{kind}s": names for kind, names in names_by_kind.items() if names}

    @property
    def options(self) -> dict[str, Any]:
        """The scene in a record: the file's content, and check sums of its data files."""
        return {"options": as_json(self.content), "data": self.data} | ({"case": self.case} if self.case else {})

    @property
    def described(self) -> str:
        """The title."""
        return f"{self.title}, case {self.case}" if self.case else str(self.title)

    def on(self, spaces: "Sequence[Space]") -> "FileScene":
        """Return the same scene with its rods on these spaces, one a rod."""
        chosen: dict[str, dict[str, Any]] = {}
        rest: dict[str, Any] = dict.fromkeys(_SPACE)
        for name, space in zip(self.plans, spaces, strict=True):
            chosen[name] = {key: getattr(space, key) for key in _SPACE if getattr(space, key) is not None}
            if space.knots:
                chosen[name]["knots"] = list(space.knots)
            if space.section_degree is None:
                chosen[name]["section_points"] = space.points_around
            if len(space.rod.rings) > 2:
                chosen[name]["rings"] = list(space.rod.rings)
        return replace(self, spaces=chosen, **rest)

    def refined_at_contact(self, solution: Any) -> "FileScene | None":
        """Return the scene on spaces that resolve contact patches (except given spaces); None if they are resolved."""
        # Over time at the largest stored energy: at the end nothing may touch.
        solution = getattr(solution, "largest", None) or solution
        if not getattr(solution, "contacts", ()):
            return None
        from isorod.contact.patches import patches

        plans, model, state = list(self.plans.values()), solution.model, getattr(solution, "equilibrium", solution)
        # Steps over time and those of friction would be repeated: too much for the gain of line contacts.
        lines = 0 < getattr(state, "load_steps", 0) <= (1 if any(one.friction for one in model.contacts) else inf)
        moving = self.analysis == "dynamics"
        patches_of_rods = {
            k: here for k, here in patches(model, solution.contacts, lines, moving).items() if plans[k].free
        }
        return replace(self, patches=patches_of_rods) if patches_of_rods else None

    def model(self) -> "Model":
        """Return the model; raises `InputError` with file, line and place."""
        from isorod.model.model import Model

        if self.cases and not self.case:
            raise (self._top / "case").error(f"several load cases; choose one: --case {' or '.join(self.cases)}")
        bodies = [plan.body(self._use(k)) for k, plan in enumerate(self.plans.values())]

        def made(one: Call) -> Any:
            names = self._names.of(one)
            if "space" in inspect.signature(one.form.function).parameters:
                names["space"] = bodies[names.get("body", 0)].space
            return one.make(**names)

        solids = [plan.body() for plan in self._names.solids.values()]
        facets = [groups.facets for _, groups in solids]

        def meeting(one: Call) -> Any:
            names = self._names.of(one)
            if isinstance(names.get("second"), Call):
                names["second"] = names["second"].make()
            if solids or self._names.ties:
                # Loads what models are made of.
                from isorod.files.ties import built

                with one.place.locating(one.keys):
                    names = {key: built(surface, facets) for key, surface in names.items()}
            return one.make(**names)

        supports = [made(one) for one in self._names.supports.values()]
        loads = [made(one) for one in self._names.loads.values()]
        if self._gravity is not None:
            loads += [self._gravity.make(of=body, body=b) for b, body in enumerate(bodies)]
        contacts, welds = (
            [meeting(one) for one in several.values()] for several in (self._names.contacts, self._names.ties)
        )
        spin = None if self._spin is None else self._spin.make()
        with self.locating("rod"):
            model = Model(bodies, supports, spin, contacts, loads, welds, [solid for solid, _ in solids])
        try:
            # Errors of a load appear when its forces are evaluated.
            model.external  # noqa: B018
        except InputError:
            for one, load in zip(self._names.loads.values(), loads, strict=False):
                with one.place.locating(one.keys):
                    load.nodal(bodies[load.body].space)
            raise
        return model

    def measure(self, solution: Any, names: Sequence[str] | None = None) -> dict[str, object]:
        """Return the file's measures, or those of these names; without any the force of each support, or frequencies.

        Of largest values ``places`` has where they are, by their names; of a motion a list, an output each.
        """
        from isorod.output.largest import numbers

        asked = self._measures if names is None else {name: self._measures[name] for name in names}
        results, places = numbers({name: ask(solution=solution) for name, ask in asked.items()})
        if hasattr(solution, "summary"):
            results = solution.summary(results)
        return results | ({"places": places} if places else {})

    def named(self, text: str) -> str:
        """Return a text with the file's own names in the place of numbers."""
        return self._names.named(text)

    @contextmanager
    def locating(self, kind: str = "analysis") -> Iterator[None]:
        """Let errors of the model and its analysis be errors of the file, in its own names."""
        try:
            yield
        except (InputError, SolveError) as problem:
            place, keys = self._top / kind, {}
            if kind == "analysis" and isinstance(self.content[kind], dict):
                at = place / self.analysis
                keys = {key: at / key for key in at.table(self.content[kind][self.analysis])}
            raise self._names.located(problem, place, keys) from None
