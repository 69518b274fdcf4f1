"""The page of what can be combined, from the record of its cells: ``python -m tests.combinations_page``.

``--run TABLE ROW ...`` runs cells first and records each: what it answered or why it was refused, and how long that
took.  Without a row all of them are run, and with ``--word`` some columns alone.  Nothing else fills the record.
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

In the first tables the words are those of [`isorod run FILE`](using.md), and `compare` and two ranks; `alone` is
without any.
`--tolerance` refines the spaces until the estimated error is small enough.
"""

TITLES = {
    "statics": "Statics",
    "modes": "Modes",
    "implicit": "Motion, implicit steps",
    "explicit": "Motion, explicit steps",
    "sections": "Sections",
}

SECTIONS = """
Solid sections by functions of control points (`order`, `section_points`) or by polynomials (`section_degree`), one with
a hole, a core in its sheath, and a tube of two layers (`rings`). Of layers the inner one has the law of the row, the
other ν = 0.3. `mixed` is ν = 0.5 and, of fibres, no change of volume.
"""


def run(table: str, row: str, column: str, seconds: float) -> dict[str, Any]:
    """Return what is recorded of a cell: ``refused`` (empty if it answers) and ``seconds``, or ``unfinished``, seconds.

    What did neither is ``broken``.
    """
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        try:
            done = combinations.outcome(table, row, column, Path(folder) / "cell", seconds)
        except subprocess.TimeoutExpired:
            return {"unfinished": seconds}
        took = time.perf_counter() - start
    try:
        return {"refused": combinations.refusal(*done), "seconds": round(took, 1)}
    except AssertionError as problem:
        # The page is not made of such a record (`page`).
        return {"broken": str(problem).strip().splitlines()[-1]}


def read() -> dict[str, Any]:
    """Return the record: cells by table, row and column."""
    return json.loads(RECORD.read_text()) if RECORD.exists() else {}


def keep(record: dict[str, Any]) -> None:
    """Write the record, in the order of the table."""
    ordered = {
        table: {row: {column: record[table][row][column] for column in columns} for row in rows if row in record[table]}
        for table, (rows, columns) in combinations.TABLES.items()
        if table in record
    }
    RECORD.write_text(_lines(ordered))


def _lines(record: dict[str, Any]) -> str:
    """Return JSON with a line for each cell, so that a change shows what changed."""
    tables = []
    for table, rows in record.items():
        lines = []
        for row, cells in rows.items():
            own = ",\n".join(f"   {json.dumps(column)}: {json.dumps(cell)}" for column, cell in cells.items())
            lines.append(f"  {json.dumps(row)}: {{\n{own}}}")
        tables.append(f" {json.dumps(table)}: {{\n" + ",\n".join(lines) + "}")
    return "{\n" + ",\n".join(tables) + "}\n"


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
    parts += [_table(table, rows) for table, rows in record.items()]
    return "\n".join(parts)


def _table(table: str, features: dict[str, Any]) -> str:
    """Return a table and the lines of what it refuses, each once."""
    words = list(combinations.TABLES[table][1])
    lines: list[str] = []
    rows = [
        "| | " + " | ".join(f"`{word}`" if word.startswith("--") else word for word in words) + " |",
        "|---|" + "---|" * len(words),
    ]
    for feature, cells in features.items():
        rows.append(f"| {feature} | " + " | ".join(_cell(cells[word], lines) for word in words) + " |")
    notes = [f"{number}. `{line}`" for number, line in enumerate(lines, 1)]
    head = f"## {TITLES[table]}\n" + (SECTIONS if table == "sections" else "")
    return "\n".join([head, *rows, *([""] if notes else []), *notes, ""])


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
    parser.add_argument("--run", nargs="+", metavar="NAME", help="a table, and rows")
    parser.add_argument("--word", action="append", help="these columns alone")
    parser.add_argument("--seconds", type=float, default=180.0, help="how long a cell may take")
    chosen = parser.parse_args(arguments)
    record = read()
    if chosen.run:
        table, *some = chosen.run
        rows, columns = combinations.TABLES[table]
        own = record.setdefault(table, {})
        for name in some or rows:
            row = own.setdefault(name, {key: {"unfinished": 0.0} for key in columns})
            for column in chosen.word or columns:
                row[column] = run(table, name, column, chosen.seconds)
                print(f"{table:9} {name:13} {column:13} {row[column]}", flush=True)
                keep(record)
    PAGE.write_text(page(record))


if __name__ == "__main__":
    main()
