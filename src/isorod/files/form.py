"""Functions and classes that a scene file calls: their parameters are its keys."""

import inspect
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import Any, NamedTuple

from isorod.errors import evaluated
from isorod.files.data import Points
from isorod.files.document import Place, shown
from isorod.files.values import Kind, value_of, words


class Name(NamedTuple):
    """The name of a rod, a support, an obstacle, a contact, a tie or a surface, and where it stands."""

    place: Place
    name: str

    def among(self, known: Mapping[str, Any]) -> Any:
        """Return what it names; raises `InputError` with the nearest of the names there are."""
        if self.name not in known:
            raise self.place.unknown(self.name, known)
        return known[self.name]


def _named(kind: str) -> Kind:
    """Return the kind of names of something."""

    def make(place: Place, value: Any) -> Name:
        if not isinstance(value, str):
            raise place.error(f"got {shown(value)}, need the name of a {kind}")
        return Name(place, value)

    return Kind(make, f"the name of a {kind}", kind)


ROD, SUPPORT, LOAD, CONTACT, TIE, OBSTACLE, PARTNER, SURFACE, GROUP = map(
    _named,
    ("rod", "support", "load", "contact", "tie", "obstacle", "rod, obstacle or solid", "surface", "group"),
)


class Parameter(NamedTuple):
    """A key of a scene file: the function's name for it, its kind, its default.

    The kind is an annotation, a `Kind`, or the words of which one is called to make the value.
    """

    name: str
    kind: Any
    default: Any

    @property
    def required(self) -> bool:
        """Whether it must be given."""
        return self.default is inspect.Parameter.empty

    @property
    def words(self) -> str:
        """What its value may be."""
        return f"one of {', '.join(self.kind)}" if isinstance(self.kind, dict) else words(self.kind)


@dataclass(frozen=True)
class Form:
    """A function or class that a file calls.

    Parameters
    ----------
    target
        Its place, such as ``"isorod.geometry.coils:helix"``; imported when it is needed.
    main
        Key that is meant where a word has a value and not a table; the first that must be given, or the first of all.
    kinds
        Parameters with more conditions than their annotations.
    defaults
        Values of parameters that are optional in files, though required by the function.
    keys
        Parameters that have another name in files.
    left
        Parameters that files do not give.
    more
        Kinds of keys that are no parameters but for whoever reads the file, or that are other names of one.
    """

    target: str
    main: str | None = None
    kinds: Mapping[str, Any] = field(default_factory=dict)
    defaults: Mapping[str, Any] = field(default_factory=dict)
    keys: Mapping[str, str] = field(default_factory=dict)
    left: tuple[str, ...] = ()
    more: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def function(self) -> Any:
        """What is called."""
        module, _, names = self.target.partition(":")
        target: Any = import_module(module)
        for name in names.split("."):
            target = getattr(target, name)
        return target

    @cached_property
    def solution(self) -> Any:
        """The annotation of what a measure is taken of."""
        return inspect.signature(self.function).parameters["solution"].annotation

    @cached_property
    def parameters(self) -> dict[str, Parameter]:
        """The keys it has in a file."""
        module = vars(sys.modules[self.function.__module__])
        result = {}
        for name, one in inspect.signature(self.function).parameters.items():
            if name not in ("self", *self.left):
                kind = self.kinds.get(name) or evaluated(one.annotation, module)
                result[self.keys.get(name, name)] = Parameter(name, kind, self.defaults.get(name, one.default))
        return result | {key: Parameter(key, kind, None) for key, kind in self.more.items()}

    @property
    def principal(self) -> str | None:
        """The main key, if it has any."""
        settable = [key for key, one in self.parameters.items() if one.name not in self.defaults]
        required = [key for key in settable if self.parameters[key].required]
        return self.main or next(iter([*required, *settable]), None)


class Call:
    """A call that a file asks for, its arguments held to the parameters of the form.

    Parameters
    ----------
    place
        Where it stands.
    form
        What is called.
    given
        Value and place of each key.

    Attributes
    ----------
    arguments
        What the function is given, by its own names; a `Call` or a `Name` where the parameter's kind says so.
    keys
        Where each key stands.

    Raises
    ------
    InputError
        If a key is not known or missing, or a value not of its kind.
    """

    def __init__(self, place: Place, form: Form, given: Mapping[str, tuple[Any, Place]]) -> None:
        self.place, self.form = place, form
        self.keys = {key: at for key, (_, at) in given.items()}
        self.arguments = {one.name: one.default for one in form.parameters.values() if one.name in form.defaults}
        for key, (value, at) in given.items():
            if key not in form.parameters:
                # Whoever knows Python writes what it is called there.
                same = next((f"{k} ({one.words})" for k, one in form.parameters.items() if one.name == key), None)
                raise at.error(f"is called {same} in a file") if same else at.unknown_key(form.parameters)
            one = form.parameters[key]
            other = next(
                (k for k in given if k != key and k in form.parameters and form.parameters[k].name == one.name), None
            )
            if other is not None:
                raise at.error(f"given twice, by {other} too")
            made = choice(at, one.kind, value) if isinstance(one.kind, dict) else value_of(at, value, one.kind)
            self.arguments[one.name] = made
        for key, one in form.parameters.items():
            if one.required and key not in given:
                raise place.error(f"{key} is missing: {one.words}")

    def make(self, /, **more: Any) -> Any:
        """Call the function; what it refuses is an error of this place, or of the key that the message speaks of."""
        with self.place.locating(self.keys):
            given = {
                name: one.make() if isinstance(one, Call | Several | Points) else one
                for name, one in self.arguments.items()
            }
            return self.form.function(**given | more)


class Several(list[Call]):
    """Calls in a list, made in order."""

    def make(self) -> list[Any]:
        """Return what they make."""
        return [one.make() for one in self]


def table(form: Form, words: str) -> Kind:
    """Return the kind of tables whose keys are those of a form."""
    return Kind(lambda place, value: call(place, form, place.table(value)), words)


def several(forms: Mapping[str, Form], words: str) -> Kind:
    """Return the kind of lists of which each entry is one of several words."""

    def make(place: Place, value: Any) -> Several:
        if not isinstance(value, list):
            raise place.error(f"got {shown(value)}, need {words}")
        return Several(choice(place / k, forms, one) for k, one in enumerate(value))

    return Kind(make, words)


def call(place: Place, form: Form, table: Mapping[str, Any]) -> Call:
    """Return the call of a form whose keys are those of a table."""
    return Call(place, form, {key: (value, place / key) for key, value in table.items()})


def choice(place: Place, forms: Mapping[str, Form], value: Any) -> Call:
    """Return the call that a value names by one of several words.

    Three notations are equivalent: ``{circle = {radius = 2.0, n = 8}}``, ``{circle = 2.0, n = 8}``, and, of what
        needs no more, the word alone.
    """
    if isinstance(value, str):
        if value not in forms:
            raise place.unknown(value, forms)
        return call(place, forms[value], {})
    table = place.table(value)
    chosen_words = [key for key in table if key in forms]
    if not chosen_words:
        raise (
            (place / next(iter(table))).unknown_key(forms) if table else place.error(f"need one of {', '.join(forms)}")
        )
    word, form, at = chosen_words[0], forms[chosen_words[0]], place / chosen_words[0]
    inner, beside = table[word], {key: (one, place / key) for key, one in table.items() if key != word}
    second = next((key for key in chosen_words[1:] if key not in form.parameters), None)
    if second is not None:
        raise (place / second).error(f"beside {word}: need one of the two")
    principal = form.principal
    if isinstance(inner, dict) and (principal is None or not isinstance(form.parameters[principal].kind, dict)):
        given = {key: (one, at / key) for key, one in inner.items()}
    elif principal is None:
        raise at.error(f"got {shown(inner)}, need nothing: {word} = {{}}")
    else:
        given = {principal: (inner, at)}
    twice = next((key for key in beside if key in given), None)
    if twice is not None:
        raise (place / twice).error(f"given twice, by {at} too")
    return Call(at, form, given | beside)
