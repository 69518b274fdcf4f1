"""A study's run: the file of its records, its level, and its progress."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any
from uuid import uuid4

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from isorod.output import results

LEVELS = ("quick", "full")


@dataclass
class Run:
    """One run of a study.

    Parameters
    ----------
    study
        Name of the study; its records are lines of ``<folder>/<study>.jsonl``.
    level
        ``"quick"`` or ``"full"``.
    folder
        Results folder.
    """

    study: str
    level: str
    folder: Path
    identity: str = field(default_factory=lambda: uuid4().hex[:12])
    started: float = field(default_factory=perf_counter)

    @property
    def path(self) -> Path:
        """The file of records."""
        return self.folder / f"{self.study}.jsonl"

    def record(self, part: str, values: dict[str, Any]) -> dict[str, Any]:
        """Append a record, complete with provenance, and return it."""
        head = {"study": self.study, "run": self.identity, "level": self.level, "part": part}
        entry = results.provenance() | values | head
        results.append(self.path, entry)
        return entry

    @contextlib.contextmanager
    def progress(self, total: int) -> Iterator["Steps"]:
        """Show a bar of ``total`` steps on a terminal, a line a step elsewhere."""
        console = Console(stderr=True)
        if not console.is_terminal:
            yield Steps(total, console, None)
            return
        columns = (TextColumn("{task.description:48.48}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        with Progress(*columns, console=console) as bar:
            yield Steps(total, console, bar)


class Steps:
    """Progress through the steps of a study."""

    def __init__(self, total: int, console: Console, bar: Progress | None) -> None:
        self._total, self._console, self._bar = total, console, bar
        self._done = 0
        self._task = bar.add_task("", total=total) if bar else None

    @contextlib.contextmanager
    def step(self, text: str) -> Iterator[None]:
        """Name a step while it runs, and count it when it is done."""
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, description=text)
        start = perf_counter()
        yield
        self._done += 1
        if self._bar is not None and self._task is not None:
            self._bar.advance(self._task)
        else:
            seconds = perf_counter() - start
            self._console.print(f"[{self._done}/{self._total}] {text}  {seconds:.1f} s", highlight=False, markup=False)
