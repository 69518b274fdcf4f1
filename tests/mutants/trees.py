"""Copies of the tree to break, and pytest in them."""

import ast
import hashlib
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

CODE = ("src/isorod", "comparisons", "meshes")


def listed(root: Path) -> list[str]:
    """Return the files of the tree that git does not ignore, deleted ones apart."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True).stdout.splitlines()
    return sorted(name for name in set(names) if (root / name).is_file())


def digest(root: Path, tests: list[str]) -> str:
    """Return in short what these test files' outcome depends on: they, the code, and what all tests share."""
    text = hashlib.sha256()
    for name in listed(root):
        shared = name.startswith("tests/") and name not in test_files(root) and not name.startswith("tests/mutants/")
        if name in tests or name == "pyproject.toml" or (name.endswith(".py") and (shared or name.startswith(CODE))):
            text.update(name.encode() + b"\0" + (root / name).read_bytes() + b"\0")
    return text.hexdigest()[:16]


def test_files(root: Path) -> list[str]:
    """Return the files that pytest collects tests from."""
    return sorted(str(path.relative_to(root)) for path in (root / "tests").rglob("test_*.py"))


def update(root: Path, tree: Path) -> None:
    """Make the tree a copy of what git lists; with the times, by which numba knows that its cache of a file holds.

    What is compiled there is kept as long as the code is the same.
    """
    stamp, code = tree.with_suffix(".code"), digest(root, [])
    if not (stamp.exists() and stamp.read_text() == code):
        shutil.rmtree(tree, ignore_errors=True)
    for name in listed(root):
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(root / name, tree / name)
    stamp.write_text(code)


def forget_compiled(tree: Path, path: str) -> list[str]:
    """Delete numba's cache of all files that import this one, directly or not, and return their modules.

    It is keyed by each file's own time and size, and would run what it has inlined of the old one.
    """
    importers = {path} | {name for name, them in imports(tree).items() if path in them}
    modules = []
    for name in sorted(importers):
        file = tree / name
        old = list((file.parent / "__pycache__").glob(f"{file.stem}.*.nb[ic]"))
        for one in old:
            one.unlink()
        if old:
            modules.append(module(name))
    return modules


def module(path: str) -> str:
    """Return the dotted name of a file of the tree."""
    return path.removeprefix("src/").removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def imports(tree: Path) -> dict[str, set[str]]:
    """Return for each file of the code the files that it imports, directly or not."""
    paths = [str(file.relative_to(tree)) for part in CODE for file in (tree / part).rglob("*.py")]
    by_name = {module(path): path for path in paths}
    reached = {path: _imported((tree / path).read_text(), by_name) for path in paths}
    while True:
        more = {path: them.union(*(reached[one] for one in them)) for path, them in reached.items()}
        if more == reached:
            return reached
        reached = more


def _imported(code: str, by_name: dict[str, str]) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            names |= {one.name for one in node.names}
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{one.name}" for one in node.names}
    return {by_name[name] for name in names if name in by_name}


def environment(tree: Path, **more: str) -> dict[str, str]:
    """Return the environment in which the tree's own code is run, one thread a rank."""
    fixed = {
        "PYTHONPATH": str(tree / "src"),
        "OMP_NUM_THREADS": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "PYTHONNOUSERSITE": "1",
    }
    # not the place of another cache, nor what an outer measurement has set
    foreign = ("NUMBA_CACHE_DIR", "COVERAGE_", "MUTANTS_")
    kept = {name: text for name, text in os.environ.items() if not name.startswith(foreign)}
    return kept | fixed | more


def run(
    tree: Path, arguments: list[str], limit: float | None = None, log: Path | None = None, **more: str
) -> int | None:
    """Run Python in the tree and return its exit code, or None where it was stopped at its time limit (seconds)."""
    with open(log or os.devnull, "wb") as said:
        process = subprocess.Popen(
            [sys.executable, *arguments],
            cwd=tree,
            env=environment(tree, **more),
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            return process.wait(limit)
        except subprocess.TimeoutExpired:
            return None
        finally:
            # and what it started: nothing of a mutant may go on beside the next one
            try:
                os.killpg(process.pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
            process.wait()
