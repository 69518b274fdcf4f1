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
    given = parser.known(arguments)
    for word, study in (("case", "stability"), ("law", "laws"), ("scene", "laws")):
        names = getattr(given, f"{word}s")
        if names and given.command != study:
            parser.error(f"--{word} {names[0]}: only the study {study} has {word}s")
    if given.dolfinx and given.command not in (*VERSIONS, "verify"):
        parser.error(f"--dolfinx {given.dolfinx[0]}: only {', '.join(VERSIONS)} compare versions of dolfinx")
    whole_number("--ranks", given.ranks, 1, 1024)
    if given.ranks > 1 and given.command != COMPARED:
        parser.error(f"--ranks {given.ranks}: only compare takes ranks")
    if given.command == COMPARED and given.scene is None:
        parser.error("compare: no scene is named; name one: NAME.toml, spring or blade")
    if given.command != COMPARED and given.scene is not None:
        parser.error(f"{given.command} {given.scene}: only compare takes a scene")
    results.check_folder(given.results)
    others = _others(given.dolfinx)
    level = given.level or ("quick" if given.command in ("verify", "bench", COMPARED) else "full")
    only = None
    if given.scene is not None:
        only = import_module(f"comparisons.{COMPARED}").main(given.scene, level, given.results, given.ranks)
    folder = results.make_folder(given.results)
    for study in STUDIES:
        if given.command == study or (given.command == "verify" and study in VERIFIED):
            run = Run(study, level, folder)
            chosen = (given.laws, given.scenes) if study == "laws" else [one for one in (given.cases or others,) if one]
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
