"""The count of lines that CONTRIBUTING asks for."""

from tests.size import Size, of

TEXT = '''"""A docstring
of two lines."""

# a comment
import sys  # and one beside code


class It:
    """What it is."""

    def many(self, a, b, c, d, /, e, f, *, g):
        """Return a text

        of several lines."""
        return """two
lines"""

    def few(self, a, *more, **named):
        pass
'''


def test_comments_docstrings_and_blanks_are_no_code():
    assert of(TEXT) == Size(files=1, lines=7, classes=1, functions=2, many=1)
    assert of("") == Size(1, 0, 0, 0, 0)
