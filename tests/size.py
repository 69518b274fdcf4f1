"""How large the code is: ``python -m tests.size [TREE...]`` prints a table of each tree (this one).

Lines of code are those with something else on them than comments and docstrings.  Functions of many arguments have
eight or more, ``self`` counted.
"""

import ast
import io
import sys
import tokenize
from pathlib import Path
from typing import NamedTuple

PARTS = ("src", "comparisons", "tests")
MANY = 8

_BLANK = {
    *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT),
    *(tokenize.ENCODING, tokenize.ENDMARKER),
}


class Size(NamedTuple):
    """Of a file, or the sum of several: files, lines of code, classes, functions, and those of many arguments."""

    files: int
    lines: int
    classes: int
    functions: int
    many: int


def of(text: str) -> Size:
    """Return the size of a file's text."""
    nodes = [*ast.walk(ast.parse(text))]
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef)]
    classes = [node for node in nodes if isinstance(node, ast.ClassDef)]
    lines = {
        line
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type not in _BLANK
        for line in range(token.start[0], token.end[0] + 1)
    }
    for node in (one for one in nodes if isinstance(one, ast.Module | ast.ClassDef | ast.FunctionDef)):
        if ast.get_docstring(node, clean=False) is not None:
            lines -= {*range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1)}
    many = sum(_arguments(node.args) >= MANY for node in functions)
    return Size(1, len(lines), len(classes), len(functions), many)


def total(folder: Path) -> Size:
    """Return the size of all Python files under a folder."""
    sizes = [of(file.read_text()) for file in folder.rglob("*.py")]
    return Size(*map(sum, zip(*sizes, strict=True)))


def _arguments(given: ast.arguments) -> int:
    return len(given.posonlyargs) + len(given.args) + len(given.kwonlyargs)


def main() -> None:
    """Print the table."""
    for tree in sys.argv[1:] or [Path(__file__).parent.parent]:
        heads = ("files", "lines of code", "classes", "functions", f"of {MANY} arguments")
        print(f"{'':12}" + "".join(f"{head:>16}" for head in heads) + f"  {tree}")
        for part in PARTS:
            print(f"{part:12}" + "".join(f"{count:16,}" for count in total(Path(tree) / part)))


if __name__ == "__main__":
    main()
