"""``python -m comparisons STUDY``: run a study, write its records and the report page."""

import sys
from collections.abc import Sequence
from importlib import import_module

from comparisons import COMPARED, STUDIES
from comparisons.measure import timing
from comparisons.measure.study import LEVELS, Run
from comparisons.stability import CASES
from isorod.command import ending
from isorod.command.parser import Parser
from isorod.errors import InputError, whole_number
from isorod.output import results

# What the main job runs.
VERIFIED = ("spring", "blade")
# Those that measure more than one dolfinx.
VERSIONS = (*VERIFIED, "bench")
COMMANDS = (*STUDIES, COMPARED, "verify", "report")


def main(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit code, other than 0 with one line on standard error."""
    program = "isorod" if arguments[:1] == [COMPARED] else "comparisons"
    return ending.run(program, lambda: _main(arguments), "the records written so far are kept")


def _main(arguments: Sequence[str]) -> int:
    parser = Parser(prog="python -m comparisons", description="Error against run time, measured here.")
    parser.add_argument(
        "command",
        choices=COMMANDS,
        help="a study; compare: a scene of yours; verify: spring and blade at quick level; report: the page again",
    )
    parser.add_argument("scene", nargs="?", metavar="SCENE", help="compare: NAME.toml, spring or blade")
    parser.add_argument(
        "--level", choices=LEVELS, help="quick (that of verify, compare and bench) or full (a study's own)"
    )
    parser.add_argument(
        "--case",
        action="append",
        choices=CASES,
        default=[],
        dest="cases",
        help="of the stability study, this case alone (repeat for more)",
    )
    for word in ("law", "scene"):
        about = f"laws: this {word} alone (repeat for more)"
        parser.add_argument(f"--{word}", action="append", default=[], dest=f"{word}s", metavar="NAME", help=about)
    parser.add_argument(
        "--dolfinx",
        action="append",
        default=[],
        metavar="PYTHON",
        help="spring, blade, bench: measure this Python's dolfinx beside that of the running one (repeat for more)",
    )
    parser.add_argument("--ranks", type=int, default=1, metavar="N", help="compare: both programs on so many ranks (1)")
    parser.add_argument("--results", default="results", metavar="DIR", help="folder of records and report (results)")
    found = parser.known(arguments)
    for word, study in (("case", "stability"), ("law", "laws"), ("scene", "laws")):
        given = getattr(found, f"{word}s")
        if given and found.command != study:
            parser.error(f"--{word} {given[0]}: only the study {study} has {word}s")
    if found.dolfinx and found.command not in (*VERSIONS, "verify"):
        parser.error(f"--dolfinx {found.dolfinx[0]}: only {', '.join(VERSIONS)} compare versions of dolfinx")
    whole_number("--ranks", found.ranks, 1, 1024)
    if found.ranks > 1 and found.command != COMPARED:
        parser.error(f"--ranks {found.ranks}: only compare takes ranks")
    if found.command == COMPARED and found.scene is None:
        parser.error("compare: no scene is named; name one: NAME.toml, spring or blade")
    if found.command != COMPARED and found.scene is not None:
        parser.error(f"{found.command} {found.scene}: only compare takes a scene")
    results.check_folder(found.results)
    others = _others(found.dolfinx)
    level = found.level or ("quick" if found.command in ("verify", "bench", COMPARED) else "full")
    only = None
    if found.scene is not None:
        only = import_module(f"comparisons.{COMPARED}").main(found.scene, level, found.results, found.ranks)
    folder = results.make_folder(found.results)
    for study in STUDIES:
        if found.command == study or (found.command == "verify" and study in VERIFIED):
            run = Run(study, level, folder)
            chosen = (found.laws, found.scenes) if study == "laws" else [one for one in (found.cases or others,) if one]
            import_module(f"comparisons.{study}").run(run, *chosen)
            run.record("end", {})
    from comparisons.report import page

    path = page.write(folder)
    for line in page.summary(folder, only):
        print(line)
    print(f"report: {path}")
    return 0


def _others(programs: Sequence[str]) -> list[str]:
    """Return the paths of other interpreters; each must have a dolfinx of a version of its own."""
    if not programs:
        return []
    versions = {timing.find_dolfinx(sys.executable)[1]: sys.executable}
    for program in programs:
        path, version = timing.find_dolfinx(program)
        if version in versions:
            raise InputError(f"--dolfinx {program}: dolfinx {version} is measured already, by {versions[version]}")
        versions[version] = path
    return list(versions.values())[1:]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
