"""What is chosen as a model is built, kept so that it can be built of other numbers on the same discretisation.

Numbers of elements, of functions and of points jump as lengths change.  A derivative is that of one discrete model: the
models beside it are built with the choices of this one, in the order in which they were made.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from isorod.errors import InputError

T = TypeVar("T")


class Choices:
    """Choices in the order in which they were made, and the one that is next where they are repeated."""

    def __init__(self) -> None:
        self.made: list[Any] = []
        self.next: int | None = None
        # Whether they are repeated so near to what they were made for that what was in order is.
        self.near = False
        # What was built, by what it was built of, and the choices within.
        self.built: dict[Any, tuple[Any, int]] = {}


_current: Choices | None = None


@contextmanager
def kept() -> Iterator[Choices]:
    """Keep the choices that are made within."""
    choices = Choices()
    with _as_current(choices):
        yield choices


@contextmanager
def repeated(choices: Choices, near: bool = False) -> Iterator[None]:
    """Let what is built within have these choices; where it is near to what they were made for, a rod does not fold.

    Raises
    ------
    InputError
        If it makes more of them, or fewer: it is another model.
    """
    choices.next, choices.near = 0, near
    with _as_current(choices):
        yield
    if choices.next != len(choices.made):
        raise InputError("the discretisation changes with the parameter")


def near() -> bool:
    """Whether what is built is near to what was looked at."""
    return _current is not None and _current.near


def chosen(choose: Callable[[], T]) -> T:
    """Return a choice: what is repeated, else what ``choose`` returns; choices within that are a part of it."""
    choices = _current
    if choices is None:
        return choose()
    if choices.next is None:
        with _as_current(None):
            choice = choose()
        choices.made.append(choice)
        return choice
    if choices.next == len(choices.made):
        raise InputError("the discretisation changes with the parameter")
    choices.next += 1
    known: T = choices.made[choices.next - 1]
    return known


def same(of: Any, build: Callable[[], T]) -> T:
    """Return what is built of something hashable, and nothing else: where choices are repeated, what there is of it."""
    choices = _current
    if choices is None:
        return build()
    if choices.next is None:
        before = len(choices.made)
        result = build()
        choices.built[of] = result, len(choices.made) - before
        return result
    if of not in choices.built:
        return build()
    known, count = choices.built[of]
    choices.next += count
    return known  # type: ignore[no-any-return]


@contextmanager
def _as_current(choices: Choices | None) -> Iterator[None]:
    global _current
    before, _current = _current, choices
    try:
        yield
    finally:
        _current = before
