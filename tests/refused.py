"""Tables of bad input, each one test: what is done, and the message of one line that refuses it."""

import re
from collections.abc import Callable

import pytest

from isorod.errors import InputError


def refused(*rows: tuple, by: Callable | None = None, error: type[Exception] = InputError) -> Callable:
    """Return a test of rows ``(call, message)``, or ``(*arguments, message)`` of ``by``.

    Each raises the error, in one line that has the message, a text or a pattern.
    """

    @pytest.mark.parametrize("row", rows, ids=[str(row[-1]) for row in rows])
    def test(row: tuple) -> None:
        *given, message = row
        with pytest.raises(error) as caught:
            by(*given) if by else given[0]()
        said = str(caught.value)
        assert "\n" not in said
        assert message in said or re.search(message, said), (message, said)

    return test
