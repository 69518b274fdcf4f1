"""Pairs of rods pushed through each other (`pushed`), each within a time: a line a seed, and how many came to what.

``python tests/push_pairs.py 0 500 --limit 120``; it exits with 1 where the rule was broken, or time ran out.
"""

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator
from multiprocessing import get_context
from multiprocessing.connection import Connection

# What is no answer.
BAD = "wrong", "crashed", "late"


def judged(seeds: Iterable[int], limit: float) -> Iterator[tuple[int, float, str]]:
    """Yield each seed, the seconds it took, and what came of it; ``late`` after ``limit`` seconds.

    A process apart does the work: nothing else ends compiled loops that hang.
    """
    context = get_context("spawn")
    worker = None
    try:
        for seed in seeds:
            if worker is None:
                here, there = context.Pipe()
                worker = context.Process(target=_work, args=(there,), daemon=True)
                worker.start()
                there.close()
                here.recv()
            here.send(seed)
            try:
                found = here.recv() if here.poll(limit) else None
                end = f"late: no answer after {limit:g} s"
            except EOFError:
                found, end = None, "crashed: the process ended"
            if found is None:
                worker.kill()
                worker.join()
                worker = None
            yield (seed, limit, end) if found is None else (seed, *found)
    finally:
        if worker is not None:
            worker.kill()
            worker.join()


def _work(pipe: Connection) -> None:
    """Answer each seed with seconds and words."""
    from pushed import outcome

    pipe.send("ready")
    while True:
        seed = pipe.recv()
        try:
            said, seconds = outcome(seed)
        except AssertionError as broken:
            said, seconds = f"wrong: {' '.join(str(broken).split())}", 0.0
        except Exception as problem:
            said, seconds = f"crashed: {type(problem).__name__}: {' '.join(str(problem).split())}", 0.0
        pipe.send((seconds, said))


def main() -> int:
    parser = argparse.ArgumentParser(description="Push pairs of rods through each other.")
    parser.add_argument("first", type=int)
    parser.add_argument("end", type=int, help="the seed after the last")
    parser.add_argument("--limit", type=float, default=120.0, help="seconds for a pair")
    given = parser.parse_args()
    counts: Counter[str] = Counter()
    for seed, seconds, said in judged(range(given.first, given.end), given.limit):
        counts[said.split(":")[0]] += 1
        print(f"{seed} {seconds:.1f} s {said}", flush=True)
    print(", ".join(f"{count} {what}" for what, count in counts.most_common()), flush=True)
    return int(any(counts[bad] for bad in BAD))


if __name__ == "__main__":
    raise SystemExit(main())
