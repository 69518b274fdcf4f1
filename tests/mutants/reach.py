"""Which tests can notice a change of a line: those that run it or, where that is not seen, those that run what uses it.

Coverage sees no line of a compiled function; and what a module computes when it is imported, or a function keeps in a
cache, it sees in the first test only. There the tests are those of the functions that name it, followed through the code.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from tests.mutants import trees
from tests.mutants.covered import Covered


@dataclass(frozen=True)
class Scope:
    """A function with its methods' and inner functions' lines, or a statement of a module or class outside of them.

    ``names`` are those by which others use it, ``uses`` the ones that stand in it; ``hidden`` says that coverage sees not
    all the tests that depend on it, ``inlined`` that compiled code elsewhere may hold a copy of it.
    """

    path: str
    first: int
    last: int
    body: int
    names: frozenset[str]
    uses: frozenset[str]
    hidden: bool
    inlined: bool


class Reach:
    """The scopes of the code and the tests that reach each."""

    def __init__(self, tree: Path, covered: Covered):
        self.covered = covered
        self._imports = trees.imports(tree)
        self._trees = {path: ast.parse((tree / path).read_text()) for path in self._imports}

    @cached_property
    def _scopes(self) -> dict[str, list[Scope]]:
        return {path: list(_scopes(path, code.body, frozenset())) for path, code in self._trees.items()}

    @cached_property
    def _users(self) -> dict[str, list[Scope]]:
        users: dict[str, list[Scope]] = {}
        for scopes in self._scopes.values():
            for scope in scopes:
                for name in scope.uses:
                    users.setdefault(name, []).append(scope)
        return users

    def scope(self, path: str, line: int) -> Scope | None:
        """Return the scope that the line belongs to, decorators and all."""
        return next((scope for scope in self._scopes[path] if scope.first <= line <= scope.last), None)

    def tests(self, path: str, line: int) -> set[str]:
        """Return the tests that can notice a change of the line."""
        scope = self.scope(path, line)
        if scope is None:
            return set()
        if line < scope.body:  # default values: whoever calls it
            return self._of(scope)
        first, last = _statement(self._trees[path], line)
        seen = self.covered.tests(path, first, last)
        return seen | self._through(scope) if scope.hidden else seen

    def inlined(self, path: str, line: int) -> bool:
        """Return whether compiled functions of other files may hold a copy of the line."""
        scope = self.scope(path, line)
        return scope is not None and scope.inlined

    def _of(self, scope: Scope) -> set[str]:
        found = self.covered.tests(scope.path, scope.body, scope.last)
        return found | self._through(scope) if scope.hidden else found

    def _through(self, start: Scope) -> set[str]:
        """Return the tests that run a function which uses the scope, directly or through others that are hidden."""
        found: set[str] = set()
        waiting, known = [start], {start}
        while waiting:
            scope = waiting.pop()
            for user in (user for name in scope.names for user in self._users.get(name, [])):
                if user in known or not (user.path == scope.path or scope.path in self._imports[user.path]):
                    continue
                known.add(user)
                found |= self.covered.tests(user.path, user.body, user.last)
                if user.hidden:
                    waiting.append(user)
        return found


def _scopes(path: str, body: list[ast.stmt], owner: frozenset[str]) -> Iterator[Scope]:
    """Go through the statements of a module or class; a class hands its name on to what it consists of."""
    for node in body:
        first = min([node.lineno, *(one.lineno for one in getattr(node, "decorator_list", []))])
        last = node.end_lineno or first
        if isinstance(node, ast.ClassDef):
            yield from _scopes(path, node.body, owner | {node.name})
            last = node.body[0].lineno - 1
            if first > last:
                continue
        if isinstance(node, ast.FunctionDef):
            told = " ".join(ast.unparse(one) for one in node.decorator_list)
            compiled = "jit" in told
            names = frozenset({node.name}) | (owner if node.name.startswith("__") else frozenset())
            yield Scope(
                path, first, last, node.body[0].lineno, names, _uses(node), compiled or "cache" in told, compiled
            )
        elif not isinstance(node, ast.Import | ast.ImportFrom):
            names = owner | _defined(node)
            yield Scope(path, first, last, first, names, _uses(node), hidden=True, inlined=True)


def _uses(node: ast.AST) -> frozenset[str]:
    names = {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}
    return frozenset(names | {one.attr for one in ast.walk(node) if isinstance(one, ast.Attribute)})


def _defined(node: ast.stmt) -> frozenset[str]:
    names = {one.id for one in ast.walk(node) if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)}
    return frozenset(names | {one.name for one in ast.walk(node) if isinstance(one, ast.FunctionDef)})


def _statement(tree: ast.Module, line: int) -> tuple[int, int]:
    """Return the lines of the innermost statement there: of a compound one, those before its body."""
    best = (line, line)
    for node in ast.walk(tree):
        if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or 0):
            body = getattr(node, "body", None)
            last = max(node.lineno, body[0].lineno - 1) if isinstance(body, list) else node.end_lineno
            if line <= (last or 0):
                best = (node.lineno, last or line)
    return best
