"""The errors a user can cause or meet; each message is one line: what, where, what would be right."""


class InputError(ValueError):
    """A value given by the user cannot be used."""


class FoldedRodError(InputError):
    """The map from disk x axis to space is not one-to-one."""


class SolveError(RuntimeError):
    """An analysis did not reach a solution."""


def whole_number(name: str, value: float, low: int, high: int) -> int:
    """Return ``value`` as an integer, or raise `InputError` if it is not one from ``low`` to ``high``."""
    # NaN and infinity fail the comparison, before int() sees them.
    if not low <= value <= high or int(value) != value:
        raise InputError(f"{name}: got {value}, need an integer from {low} to {high}")
    return int(value)


def representable(name: str, value: float) -> None:
    """Raise `InputError` if a positive value is so far from one that products with it leave double precision."""
    if not 1e-100 <= value <= 1e100:
        raise InputError(f"{name}: got {value:g}, need 1e-100 to 1e100; choose other units")
