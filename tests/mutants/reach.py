"""Which tests can notice a change of a line: those that run it or, where that is not seen, those that run what uses it.

Coverage sees no line of a compiled function; and what a module computes when it is imported, or a function keeps in a
cache, it sees in the first test only. There the tests are those of the functions that name it, followed through the
code.
"""

import ast
from pathlib import Path

from tests.mutants.covered import Covered
from tests.mutants.scopes import Code, Name, Scope


class Reach:
    """The tests that reach each line of the code."""

    def __init__(self, tree: Path, covered: Covered):
        self.covered = covered
        self._code = Code(tree)
        self._users: dict[Name, list[Scope]] = {}
        for scopes in self._code.scopes.values():
            for scope in scopes:
                for name in scope.uses:
                    self._users.setdefault(name, []).append(scope)
        self._named: dict[str, set[str]] = {}
        for test in covered.seconds:
            self._named.setdefault(test.partition("[")[0], set()).add(test)

    def tests(self, path: str, line: int) -> set[str]:
        """Return the tests that can notice a change of the line."""
        scope = self._scope(path, line)
        if scope is None:
            return set()
        lines = _statement(self._code.parsed[path], line)
        if line < scope.body:  # default values: whoever calls it
            lines = (scope.body, scope.last)
        seen = self.covered.tests(path, *lines)
        return seen | self._through(scope) if scope.hidden else seen

    def inlined(self, path: str, line: int) -> bool:
        """Return whether compiled functions of other files may hold a copy of the line."""
        scope = self._scope(path, line)
        return scope is not None and scope.inlined

    def _scope(self, path: str, line: int) -> Scope | None:
        return next((scope for scope in self._code.scopes[path] if scope.first <= line <= scope.last), None)

    def _seen(self, scope: Scope) -> set[str]:
        """Return the tests that run lines of the scope, as far as coverage sees it; of a test function, itself."""
        if scope.path.startswith("tests/"):
            return self._named.get(f"{scope.path}::{scope.function}", set())
        return self.covered.tests(scope.path, scope.body, scope.last)

    def _through(self, start: Scope) -> set[str]:
        """Return the tests that run a function which uses the scope, directly or through others that are hidden."""
        found: set[str] = set()
        waiting, known = [start], {start}
        while waiting:
            scope = waiting.pop()
            for user in (user for name in scope.names for user in self._users.get(name, [])):
                if user not in known:
                    known.add(user)
                    found |= self._seen(user)
                    if user.hidden:
                        waiting.append(user)
        return found


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
