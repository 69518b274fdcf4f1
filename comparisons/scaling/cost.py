"""A model of time and memory by size and number of ranks, fitted to a measured run."""

from math import ceil, sqrt
from typing import Any, NamedTuple

# Unknowns of the estimated model; cores and GiB of a node.
LARGE, CORES, NODE = 100_000_000, 64, 256

# Half the width of the band, unknowns: four layers of six control points.
WIDTH = 72

# Operations a second in the factorisation of a band that wide, of one core (`isorod.petsc.banded`).
RATE = 7e9


class Cost(NamedTuple):
    """Time and memory of an unknown, solves of a run, and operations that a joint between ranks takes in each."""

    unknown: float
    bytes: float
    solves: int
    joint: float

    def chain(self, ranks: int) -> float:
        """Return the time of the joints, one after the other, seconds."""
        return (ranks - 1) * self.solves * self.joint / RATE

    def seconds(self, unknowns: int, ranks: int) -> float:
        """Return the time of a run."""
        return unknowns * self.unknown / ranks + self.chain(ranks)

    def best(self, unknowns: int) -> int:
        """Return the number of ranks that is fastest."""
        return max(1, round(sqrt(unknowns * self.unknown * RATE / (self.solves * self.joint))))

    def memory(self, unknowns: int) -> float:
        """Return bytes in all."""
        return unknowns * self.bytes

    def nodes(self, unknowns: int) -> int:
        """Return how many nodes have that memory."""
        return ceil(self.memory(unknowns) / (NODE * 2**30))


def fitted(record: dict[str, Any]) -> Cost:
    """Return the cost model of a measured run of statics.

    A joint is a dense block of the band's width: it is factorised, two blocks are solved for with it and one is
    multiplied, which is ``(1/3 + 2 + 2) width^3`` operations.
    """
    unknowns = int(record["unknowns"])
    memory = max(record["memory"]) - record["memory_before"]
    joint = (1.0 / 3.0 + 4.0) * WIDTH**3
    return Cost(float(record["total"]) / unknowns, memory / unknowns, int(record["solves"]), joint)
