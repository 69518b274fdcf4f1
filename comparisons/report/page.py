"""The report page, made from result files alone."""

import html
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from comparisons import COMPARED, STUDIES
from comparisons.measure.records import Record, newest
from comparisons.report import words
from comparisons.report.html import contents, heading
from isorod.errors import InputError
from isorod.output.results import write_beside

_STYLE = Path(__file__).with_name("style.css")


def write(folder: Path) -> Path:
    """Write ``report.html`` and its plots from the newest complete run of each study; return its path.

    The answers come first, then what it is about, the contents, the studies one by one, where the numbers come from,
    and in the end what words and letters mean.

    Raises
    ------
    InputError
        If there is no complete run of any study, or a result file is damaged.
    """
    studies = _studies(folder)
    answers: list[str] = []
    parts: list[str] = []
    for study, records in studies.items():
        with _read(folder, study):
            answers += ["<div>", *_answer(study, records), "</div>"]
            parts.extend(_part(study).section(records, folder))
    with _read(folder, *studies):
        parts += [heading(2, "Where these numbers come from"), _provenance(studies)]
    parts += [heading(2, "Words and letters"), words.words(studies)]
    body = "\n".join(parts)
    page = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>isorod: {words.TITLE}</title>\n"
        f"<style>{_STYLE.read_text()}</style></head>\n<body>\n<h1>{words.TITLE}</h1>\n"
        + "<div class=answers>"
        + "\n".join(answers)
        + f"</div>\n{words.introduction(studies)}\n{contents(body)}\n{body}\n</body></html>\n"
    )
    path = folder / "report.html"
    write_beside(path, lambda where: where.write_text(page))
    return path


def summary(folder: Path, only: str | None = None) -> list[str]:
    """Return the main findings of the newest runs, or of the one of a study, one line each."""
    lines = []
    for study, records in _studies(folder).items():
        if only not in (None, study):
            continue
        with _read(folder, study):
            lines += _part(study).summary(records)
    return lines


def _part(study: str) -> Any:
    """Return the study's module of the report.

    ``summary(records)``, its main findings as text, ``section(records, folder)``, and where it does not just repeat the
    findings ``answer(records)``, both HTML.
    """
    return import_module(f"comparisons.report.{study.partition('-')[0]}")


def _answer(study: str, records: list[Record]) -> list[str]:
    """Return the main findings of a study as HTML."""
    own = _part(study)
    if hasattr(own, "answer"):
        return list(own.answer(records))
    return [f"<p>{html.escape(line[0].upper() + line[1:])}.</p>" for line in own.summary(records)]


@contextmanager
def _read(folder: Path, *studies: str) -> Iterator[None]:
    """Raise `InputError` where records lack something that the page needs."""
    try:
        yield
    except InputError:
        raise
    except (KeyError, ValueError, TypeError, IndexError, AttributeError) as problem:
        raise InputError(
            f"results {folder}: the newest run of {' or '.join(studies)} is damaged or of another version "
            f"({type(problem).__name__}: {' '.join(str(problem).split())}); run the study again"
        ) from problem


def _studies(folder: Path) -> dict[str, list[Record]]:
    """Return the newest complete run of each study that has one."""
    # Each comparison of a scene is a study of its own.
    others = sorted(path.stem for path in folder.glob(f"{COMPARED}-*.jsonl"))
    names = [*(one for one in STUDIES if (folder / f"{one}.jsonl").is_file()), *others]
    studies = {study: newest(folder, study) for study in names}
    studies = {study: records for study, records in studies.items() if records}
    if not studies:
        raise InputError(f"results {folder}: no complete run of a study; run python -m comparisons {STUDIES[0]} first")
    return studies


def _provenance(studies: dict[str, list[Record]]) -> str:
    known: dict[str, list[str]] = {}
    runs = []
    for study, records in studies.items():
        for record in records:
            for name, version in record["versions"].items():
                if version not in known.setdefault(name, []):
                    known[name].append(version)
        last = records[-1]
        runs.append(
            f'<li><a href="{study}.jsonl">{study}.jsonl</a>: level {html.escape(last["level"])}, commit '
            f"{html.escape(str(last['commit']))}, {html.escape(last['time'])}</li>"
        )
    machine = last["machine"]
    named = ", ".join(f"{name} {' and '.join(every)}" for name, every in known.items())
    more = (
        ", <code>make verify</code> measures spring and blade at quick level and takes some minutes, <code>python -m "
        "comparisons spring</code> measures all of it"
        if set(STUDIES) & studies.keys()
        else ""
    )
    return (
        f"<ul>{''.join(runs)}</ul><p>Machine: {html.escape(machine['processor'])}, {machine['cores']} cores, "
        f"{html.escape(machine['system'])}; one thread a rank. Versions: {html.escape(named)}. This page and its plots "
        f"are made from those files alone: <code>python -m comparisons report</code> makes them again{more}.</p>"
    )
