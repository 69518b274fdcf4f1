"""The report page, made from result files alone."""

import html
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from comparisons import STUDIES
from comparisons.measure.records import Record, newest
from isorod.errors import InputError
from isorod.output.results import write_beside

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1b1b1b; max-width: 76rem; margin: 2rem auto; padding: 0 1.5rem; }
h1, h2 { line-height: 1.2; } h2 { margin-top: 2.5rem; border-bottom: 1px solid #ccc; padding-bottom: .2rem; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; font-size: .9rem; }
th, td { padding: .2rem .7rem; text-align: right; border-bottom: 1px solid #e3e3e3; }
th { border-bottom: 2px solid #888; vertical-align: bottom; } td:first-child, th:first-child { text-align: left; }
td.text, th.text { text-align: left; white-space: nowrap; }
.failures td { white-space: nowrap; } .failures td.text:last-child { white-space: normal; min-width: 22rem; }
.wide { overflow-x: auto; } code { font-size: .85em; }
img { max-width: 100%; height: auto; } .big { font-size: 1.25rem; } .small { color: #555; font-size: .85rem; }
"""


def write(folder: Path) -> Path:
    """Write ``report.html`` and its plots from the newest complete run of each study; return its path.

    Raises
    ------
    InputError
        If there is no complete run of any study, or a result file is damaged.
    """
    found = _found(folder)
    body = [f"<p class=big>{html.escape(line)}</p>" for line in summary(folder)]
    with _read(folder, *found):
        body.append(_provenance(found))
    for study, records in found.items():
        with _read(folder, study):
            body.extend(_part(study).section(records, folder))
    page = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>isorod: error against run time</title>\n'
        f"<style>{_STYLE}</style></head>\n<body>\n<h1>isorod: error against run time</h1>\n"
        + "\n".join(body)
        + "\n</body></html>\n"
    )
    path = folder / "report.html"
    write_beside(path, lambda where: where.write_text(page))
    return path


def summary(folder: Path) -> list[str]:
    """Return the main findings of the newest runs, one line each."""
    lines = []
    for study, records in _found(folder).items():
        with _read(folder, study):
            lines += _part(study).summary(records)
    return lines


def _part(study: str) -> Any:
    """Return the study's module of the report.

    ``summary(records)``, its main findings, and ``section(records, folder)``.
    """
    return import_module(f"comparisons.report.{study}")


@contextmanager
def _read(folder: Path, *studies: str) -> Iterator[None]:
    """Raise `InputError` where records lack what the page is made of."""
    try:
        yield
    except InputError:
        raise
    except (KeyError, ValueError, TypeError, IndexError, AttributeError) as problem:
        raise InputError(
            f"results {folder}: the newest run of {' or '.join(studies)} is damaged or of another version "
            f"({type(problem).__name__}: {' '.join(str(problem).split())}); run the study again"
        ) from problem


def _found(folder: Path) -> dict[str, list[Record]]:
    """Return the newest complete run of each study that has one."""
    found = {study: newest(folder, study) for study in STUDIES if (folder / f"{study}.jsonl").is_file()}
    found = {study: records for study, records in found.items() if records}
    if not found:
        raise InputError(f"results {folder}: no complete run of a study; run python -m comparisons {STUDIES[0]} first")
    return found


def _provenance(found: dict[str, list[Record]]) -> str:
    versions: dict[str, str] = {}
    runs = []
    for study, records in found.items():
        for record in records:
            versions |= record["versions"]
        last = records[-1]
        runs.append(f"{study}: level {last['level']}, commit {last['commit']}, {last['time']}")
    machine = last["machine"]
    named = ", ".join(f"{name} {version}" for name, version in versions.items())
    return (
        f"<p class=small>{html.escape('; '.join(runs))}; {html.escape(machine['processor'])}, {machine['cores']} "
        f"cores; {html.escape(named)}. One thread; run time is set-up + assembly + solve, median of the warm runs in "
        "one process; import, compilation, the Sturm count that checks modes and, for dolfinx, mesh generation are "
        "left out.</p>"
    )
