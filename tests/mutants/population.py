"""Every small wrong change that mutmut's operators make of a file, but of its text, types and decorators."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import libcst as cst
from mutmut.mutation.mutators import mutation_operators

# The half of `comparisons` that measures, wherever in it a file or folder of that name stands. The other half draws and
# writes pages, or is a study that runs for minutes.
MEASURING = {
    *("measure", "fem"),
    *("timing", "rod", "work", "convergence", "records", "study", "mac", "published", "precision"),
}
TEXT = cst.SimpleString | cst.FormattedString | cst.ConcatenatedString
# Types, what the reader of an error is told, and what numba is told; a lambda of a text is a text.
LEFT_OUT = cst.Annotation | cst.Decorator | cst.Raise | cst.ImportFrom | cst.Import | TEXT


@dataclass(frozen=True)
class Mutant:
    """One wrong change: file from the root, line (1-based), operator, the line before and after, the mutated file."""

    path: str
    line: int
    operator: str
    before: str
    after: str
    code: str

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What it is known by when lines above it come and go."""
        return self.path, self.operator, self.before, self.after


def files(root: Path) -> list[str]:
    """Return the files that are mutated, from the root, sorted: all of isorod, the measuring half of comparisons."""
    core = list((root / "src/isorod").rglob("*.py"))
    places = ((path, path.relative_to(root / "comparisons")) for path in (root / "comparisons").rglob("*.py"))
    measuring = [path for path, place in places if MEASURING & {*place.parts[:-1], place.stem}]
    return sorted(str(path.relative_to(root)) for path in core + measuring)


class Changes:
    """The changes of one file, counted without making them."""

    def __init__(self, root: Path, path: str):
        self.path = path
        self._module = cst.parse_module((root / path).read_text())
        visitor = _Visitor()
        self._module.visit(visitor)
        self._found = visitor.found

    def __len__(self) -> int:
        return len(self._found)

    def mutant(self, index: int) -> Mutant | None:
        """Return one of them; None where what comes out is no Python or the same text."""
        node, new, operator = self._found[index]
        old_code, code = self._module.code, self._module.deep_replace(node, new).code
        try:
            compile(code, self.path, "exec")
        except (SyntaxError, ValueError):
            return None
        pairs = list(_differing(old_code.splitlines(), code.splitlines()))
        if not pairs:
            return None
        line, before, after = pairs[0]
        return Mutant(self.path, line, operator, before.strip(), after.strip(), code)


def _differing(old: list[str], new: list[str]) -> Iterator[tuple[int, str, str]]:
    for number, (one, other) in enumerate(zip(old, new, strict=False), 1):
        if one != other:
            yield number, one, other


class _Visitor(cst.CSTVisitor):
    """Collect (node, what replaces it, operator)."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[cst.CSTNode, cst.CSTNode, str]] = []

    def on_visit(self, node: cst.CSTNode) -> bool:
        if isinstance(node, LEFT_OUT) or _is_for_types(node) or _lists_names(node):
            return False
        for kind, operator in mutation_operators:
            if isinstance(node, kind):
                name = operator.__name__.removeprefix("operator_")
                self.found += [(node, new, name) for new in operator(node) if not _takes_text(node, new)]
        return True


def _is_for_types(node: cst.CSTNode) -> bool:
    return isinstance(node, cst.If) and isinstance(node.test, cst.Name) and node.test.value == "TYPE_CHECKING"


def _lists_names(node: cst.CSTNode) -> bool:
    if not isinstance(node, cst.Assign):
        return False
    target = node.targets[0].target
    return isinstance(target, cst.Name) and target.value == "__all__"


def _takes_text(node: cst.CSTNode, new: cst.CSTNode) -> bool:
    """Whether the change is that a text, as argument or value, is left out or becomes None."""
    if isinstance(node, cst.Call) and isinstance(new, cst.Call):
        kept = {id(argument) for argument in new.args}
        return any(isinstance(argument.value, TEXT) for argument in node.args if id(argument) not in kept)
    if isinstance(node, cst.Assign | cst.AnnAssign) and isinstance(new, cst.Assign | cst.AnnAssign):
        return isinstance(node.value, TEXT)
    return False
