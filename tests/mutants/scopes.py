"""Who uses what: each file cut into functions and statements, their names traced to where they are made."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.mutants import trees

# a name and the file that makes it; without a file: an attribute of some object
Name = tuple[str, str]


@dataclass(frozen=True)
class Scope:
    """A function with all within it, or a statement of a module or class outside of functions.

    ``names`` are those that others use it by and ``uses`` those that stand in it. ``hidden``: coverage sees not all the
    tests that depend on it; ``inlined``: compiled code elsewhere may hold a copy. ``function``: its name, of one
    or of a test that is a table.
    """

    path: str
    first: int
    last: int
    body: int
    names: frozenset[Name]
    uses: frozenset[Name]
    hidden: bool
    inlined: bool
    function: str = ""


class Code:
    """The files of a tree, tests included, parsed."""

    def __init__(self, tree: Path):
        files = [file for part in (*trees.CODE, "tests") for file in (tree / part).rglob("*.py")]
        self.parsed = {str(file.relative_to(tree)): ast.parse(file.read_text()) for file in files}
        self._paths = {trees.module(path): path for path in self.parsed}
        self._offered = _offered(tree / "src/isorod/__init__.pyi")
        self._imported = {path: self._imports(parsed) for path, parsed in self.parsed.items()}
        self._made = {path: set().union(*map(_made, parsed.body)) for path, parsed in self.parsed.items()}
        self.scopes = {path: list(self._scopes(path, parsed.body, "")) for path, parsed in self.parsed.items()}

    def _imports(self, parsed: ast.AST) -> dict[str, tuple[str, str]]:
        """Return what names imported there stand for: (module, "") or (module, name in it)."""
        found = {}
        for node in ast.walk(parsed):
            if isinstance(node, ast.Import):
                found |= {one.asname: (one.name, "") for one in node.names if one.asname}
            if isinstance(node, ast.ImportFrom) and node.module:
                for one in node.names:
                    inner = f"{node.module}.{one.name}"
                    place = self._offered.get(inner, (node.module, one.name))
                    found[one.asname or one.name] = (inner, "") if inner in self._paths else place
        return found

    def _trace(self, path: str, name: str) -> Name | None:
        """Return where a name of a module is made, through those that only hand it on."""
        return (path, name) if name in self._made[path] else self._origin(self._imported[path].get(name, ("", "")))

    def _origin(self, imported: tuple[str, str]) -> Name | None:
        """Return where an imported name is made."""
        module, inner = imported
        return self._trace(self._paths[module], inner) if inner and module in self._paths else None

    def _scopes(self, path: str, body: list[ast.stmt], owner: str) -> Iterator[Scope]:
        for node in body:
            decorators = getattr(node, "decorator_list", [])
            first, last = min([node.lineno, *(one.lineno for one in decorators)]), node.end_lineno or node.lineno
            mine = frozenset({(path, owner)})
            if isinstance(node, ast.ClassDef):
                yield from self._scopes(path, node.body, node.name)
                head = [*decorators, *node.bases, *(one.value for one in node.keywords)]
                uses, last = self._uses(path, head, set()), max(first, node.body[0].lineno - 1)
                yield Scope(path, first, last, first, frozenset({(path, node.name)}), uses, True, True)
            elif isinstance(node, ast.FunctionDef):
                told = " ".join(ast.unparse(one) for one in decorators)
                compiled = "jit" in told
                hidden = compiled or "cache" in told or path.startswith("tests/")
                names = frozenset({("", node.name) if owner else (path, node.name)})
                uses = self._uses(path, [node], _locals(node)) | self._fixtures(path, node)
                start = node.body[0].lineno
                yield Scope(path, first, last, start, names, uses, hidden, compiled, node.name)
            elif not isinstance(node, ast.Import | ast.ImportFrom):
                names = mine if owner else frozenset((path, name) for name in _made(node))
                # A table that is a test, by `refused`.
                test = next((name for _, name in sorted(names) if name.startswith("test_")), "")
                yield Scope(path, first, last, first, names, self._uses(path, [node], set()), True, True, test)

    def _uses(self, path: str, nodes: list[ast.AST], own: set[str]) -> frozenset[Name]:
        found: set[Name | None] = set()
        # Two functions may import different things by one name.
        local = {name: it for top in nodes for name, it in self._imports(top).items()}
        for node in (one for top in nodes for one in _without_types(top)):
            if isinstance(node, ast.Dict):
                found |= self._listed(node)
            if isinstance(node, ast.Constant) and str(node.value).endswith("_kernel"):
                kernel = str(Path(path).with_name(f"{node.value}.py"))
                found |= {(kernel, name) for name in self._made.get(kernel, set())}
            if isinstance(node, ast.Name) and node.id not in own:
                found.add(self._origin(local[node.id]) if node.id in local else self._trace(path, node.id))
            if isinstance(node, ast.Attribute):
                base = node.value.id if isinstance(node.value, ast.Name) else ""
                module, inner = local.get(base, self._imported[path].get(base, ("", "")))
                known = self._paths.get(module) if not inner and base not in own else None
                found.add(self._trace(known, node.attr) if known else ("", node.attr))
        return frozenset(name for name in found if name)

    def _listed(self, table: ast.Dict) -> set[Name | None]:
        """Return what a table of modules and names in them stands for: generated code imports them."""
        found: set[Name | None] = set()
        for key, value in zip(table.keys, table.values, strict=True):
            if isinstance(key, ast.Constant) and key.value in self._paths and isinstance(value, ast.Constant):
                found |= {self._trace(self._paths[key.value], name) for name in str(value.value).split()}
        return found

    def _fixtures(self, path: str, node: ast.FunctionDef) -> frozenset[Name]:
        """Return the fixtures that a test or fixture asks for: its arguments, made in its file or in conftest.py."""
        if not path.startswith("tests/"):
            return frozenset()
        names = {one.arg for one in node.args.args}
        places = (path, "tests/conftest.py")
        return frozenset((place, name) for place in places for name in names & self._made.get(place, set()))


def _offered(file: Path) -> dict[str, tuple[str, str]]:
    """Return the module of each name that the package itself offers, and its name there."""
    nodes = ast.parse(file.read_text()).body if file.exists() else []
    imports = [node for node in nodes if isinstance(node, ast.ImportFrom) and node.module]
    return {f"isorod.{one.asname}": (node.module or "", one.name) for node in imports for one in node.names}


def _made(node: ast.AST) -> set[str]:
    """Return the names that a statement of a module makes."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return {node.name}
    inner = ast.walk(node)
    return {one.id for one in inner if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)}


def _locals(node: ast.FunctionDef) -> set[str]:
    arguments = {one.arg for one in ast.walk(node) if isinstance(one, ast.arg)}
    return arguments | {
        one.id for one in ast.walk(node) if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)
    }


def _without_types(node: ast.AST) -> Iterator[ast.AST]:
    yield node
    for name, value in ast.iter_fields(node):
        if name not in {"annotation", "returns"}:
            for one in value if isinstance(value, list) else [value]:
                if isinstance(one, ast.AST):
                    yield from _without_types(one)
