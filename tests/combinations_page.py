"""The page of what can be combined, from the record of its cells: ``python -m tests.combinations_page``.

``--run ANALYSIS FEATURE ...`` runs cells first and records each: what it answered or why it was refused, and how long
that took.  Without a feature all of them are run, and with ``--word`` some words alone.  Nothing else fills the record.
"""

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

from tests import combinations

ROOT = Path(__file__).parent.parent
RECORD = ROOT / "tests" / "combinations.json"
PAGE = ROOT / "docs" / "combinations.md"

# Seconds from which a cell says how long it took.
LONG = 20.0

HEAD = """# What can be combined

Each analysis with each feature of a scene and each word of the command, as a small scene in a file that a test runs
(`tests/combinations.py`): the command answers, or says in one line why not. The lines stand below each table; an answer
that took more than {long:.0f} seconds says so. Of {all} combinations {yes} are answered and {no} are refused{rest}.

The words are those of [`isorod run FILE`](using.md), and `compare` and two ranks; `alone` is without any.
`--tolerance` refines the spaces until the estimated error is small enough.
"""

TITLES = {
    "statics": "Statics",
    "modes": "Modes",
    "implicit": "Motion, implicit steps",
    "explicit": "Motion, explicit steps",
}


def run(analysis: str, feature: str, word: str, seconds: float) -> dict[str, Any]:
    """Return what is recorded of a cell: ``refused`` (empty if it answers) and ``seconds``, or ``unfinished``, seconds.

    What did neither is ``broken``.
    """
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        try:
            done = combinations.outcome(analysis, feature, word, Path(folder) / "cell", seconds)
        except subprocess.TimeoutExpired:
            return {"unfinished": seconds}
        took = time.perf_counter() - start
    try:
        return {"refused": combinations.refusal(*done), "seconds": round(took, 1)}
    except AssertionError as problem:
        # The page is not made of such a record (`page`).
        return {"broken": str(problem).strip().splitlines()[-1]}


def read() -> dict[str, Any]:
    """Return the record: cells by analysis, feature and word."""
    return json.loads(RECORD.read_text()) if RECORD.exists() else {}


def keep(record: dict[str, Any]) -> None:
    """Write the record, in the order of the table."""
    ordered = {
        analysis: {
            feature: {word: record[analysis][feature][word] for word in combinations.OPTIONS}
            for feature in combinations.FEATURES
            if feature in record[analysis]
        }
        for analysis in combinations.ANALYSES
        if analysis in record
    }
    RECORD.write_text(_lines(ordered))


def _lines(record: dict[str, Any]) -> str:
    """Return JSON with a line for each cell, so that a change shows what changed."""
    analyses = []
    for analysis, features in record.items():
        rows = []
        for feature, cells in features.items():
            own = ",\n".join(f"   {json.dumps(word)}: {json.dumps(cell)}" for word, cell in cells.items())
            rows.append(f"  {json.dumps(feature)}: {{\n{own}}}")
        analyses.append(f" {json.dumps(analysis)}: {{\n" + ",\n".join(rows) + "}")
    return "{\n" + ",\n".join(analyses) + "}\n"


def page(record: dict[str, Any]) -> str:
    """Return the page that a record makes."""
    cells = [cell for features in record.values() for row in features.values() for cell in row.values()]
    yes = sum(cell.get("refused") == "" for cell in cells)
    no = sum(bool(cell.get("refused")) for cell in cells)
    open_ = sum("unfinished" in cell for cell in cells)
    if yes + no + open_ < len(cells):
        raise SystemExit("combinations: a cell is broken: see the record, mend it and run it again")
    rest = f"; of {open_} nobody waited for the end (`?`, or not run)" if open_ else ""
    parts = [HEAD.format(long=LONG, all=len(cells), yes=yes, no=no, rest=rest)]
    parts += [_table(analysis, features) for analysis, features in record.items()]
    return "\n".join(parts)


def _table(analysis: str, features: dict[str, Any]) -> str:
    """Return the table of one analysis and the lines of what it refuses, each once."""
    words = list(combinations.OPTIONS)
    lines: list[str] = []
    rows = [
        "| | "
        + " | ".join(word if " " in word or word in ("alone", "compare") else f"`{word}`" for word in words)
        + " |",
        "|---|" + "---|" * len(words),
    ]
    for feature, cells in features.items():
        rows.append(f"| {feature} | " + " | ".join(_cell(cells[word], lines) for word in words) + " |")
    notes = [f"{number}. `{line}`" for number, line in enumerate(lines, 1)]
    return "\n".join([f"## {TITLES[analysis]}\n", *rows, *([""] if notes else []), *notes, ""])


def _cell(cell: dict[str, Any], lines: list[str]) -> str:
    if "unfinished" in cell:
        return f"? {cell['unfinished']:.0f} s" if cell["unfinished"] else "not run"
    if not cell["refused"]:
        return "yes" if cell["seconds"] <= LONG else f"yes, {cell['seconds']:.0f} s"
    if cell["refused"] not in lines:
        lines.append(cell["refused"])
    return f"no ({lines.index(cell['refused']) + 1})"


def main(arguments: list[str] | None = None) -> None:
    """Run cells if asked for, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", nargs="+", metavar="NAME", help="an analysis, and features")
    parser.add_argument("--word", action="append", choices=combinations.OPTIONS, help="these words alone")
    parser.add_argument("--seconds", type=float, default=180.0, help="how long a cell may take")
    chosen = parser.parse_args(arguments)
    record = read()
    if chosen.run:
        analysis, *features = chosen.run
        own = record.setdefault(analysis, {})
        for feature in features or combinations.FEATURES:
            row = own.setdefault(feature, {key: {"unfinished": 0.0} for key in combinations.OPTIONS})
            for word in chosen.word or combinations.OPTIONS:
                row[word] = run(analysis, feature, word, chosen.seconds)
                print(f"{analysis:9} {feature:13} {word:13} {row[word]}", flush=True)
                keep(record)
    PAGE.write_text(page(record))


if __name__ == "__main__":
    main()
