"""Draw mutants by a seed, try each, and print which share of them the tests catch."""

import argparse
import dataclasses
import json
import random
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from itertools import islice
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from isorod.output import results
from tests.mutants import covered, report, trees, trial
from tests.mutants.population import Changes, Mutant, files
from tests.mutants.reach import Reach

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results/mutants.jsonl"
FOLDER = ROOT / "results/mutants"


def main() -> None:
    """Run the command."""
    it = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    it.add_argument("--seed", type=int, default=1, help="of the draw (default: %(default)s)")
    it.add_argument("--count", type=int, default=200, help="mutants to draw (default: %(default)s)")
    it.add_argument("--jobs", type=int, default=1, help="mutants at a time (default: %(default)s)")
    it.add_argument(
        "--budget", type=float, default=120.0, help="seconds of tests a mutant, processor time (default: %(default)s)"
    )
    given = it.parse_args()

    tree = FOLDER / "tree"
    trees.update(ROOT, tree)
    changes = [Changes(ROOT, path) for path in files(ROOT)]
    population = sum(len(one) for one in changes)
    drawn = list(islice(_draw(changes, given.seed), given.count))
    reach = Reach(tree, covered.measure(ROOT, tree, FOLDER / "map", given.jobs))
    digest = trees.digest(ROOT, trees.test_files(ROOT))
    run = {"tree": digest, "seed": given.seed, "budget": given.budget, "population": population}
    before = _records()
    done = {_key(one): one for one in before if all(one[name] == value for name, value in run.items())}
    caught_by = {_key(one): one["by"] for one in before if one["how"] == "caught"}
    todo = [mutant for mutant in drawn if mutant.key not in done]
    print(f"{len(drawn)} of {population} mutants, seed {given.seed}; {len(drawn) - len(todo)} tried before", flush=True)

    places: SimpleQueue[Path] = SimpleQueue()
    for number in range(given.jobs):
        places.put(FOLDER / f"worker-{number}")

    def one(mutant: Mutant) -> dict[str, Any]:
        place = places.get()
        try:
            outcome = trial.run(mutant, place, tree, reach, given.budget, caught_by.get(mutant.key, ""))
        finally:
            places.put(place)
        what = {name: getattr(mutant, name) for name in ("path", "line", "operator", "before", "after")}
        return run | what | dataclasses.asdict(outcome) | results.provenance()

    with ThreadPoolExecutor(given.jobs) as pool:
        for future in as_completed([pool.submit(one, mutant) for mutant in todo]):
            record = future.result()
            results.append(RESULTS, record)
            done[_key(record)] = record
            print(report.line(record), flush=True)
    print(report.summary([done[mutant.key] for mutant in drawn], run, reach.covered.dropped))


def _draw(changes: list[Changes], seed: int) -> Iterator[Mutant]:
    """Go through all changes in an order made by the seed; those that are no Python, or seen already, do not count."""
    places = [(one, index) for one in changes for index in range(len(one))]
    random.Random(seed).shuffle(places)
    seen = set()
    for one, index in places:
        mutant = one.mutant(index)
        if mutant and mutant.key not in seen:
            seen.add(mutant.key)
            yield mutant


def _records() -> list[dict[str, Any]]:
    return [json.loads(text) for text in RESULTS.read_text().splitlines()] if RESULTS.exists() else []


def _key(record: dict[str, Any]) -> tuple[str, str, str, str]:
    return record["path"], record["operator"], record["before"], record["after"]


if __name__ == "__main__":
    sys.exit(main())
