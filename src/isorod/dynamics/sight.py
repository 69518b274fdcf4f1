"""How well the points of contacts have seen what touched in a motion; loaded by models that have contacts.

Of each contact that is asked at the output at which it pressed most: before and after, patches are smaller.
"""

from collections.abc import Iterator

from isorod.arrays import Array
from isorod.contact import result
from isorod.contact.operator import ContactOperator
from isorod.dynamics.run import Run


class Sight:
    """The contacts of a motion at their peaks.

    Parameters
    ----------
    run
        The motion, at its end.
    """

    def __init__(self, run: Run) -> None:
        self._run, self._model = run, run.system.model
        self._contact = ContactOperator(self._model, run.system.ranks.communicator)
        self._contact.look(run.system.points)

    def _peaks(self) -> Iterator[tuple[set[int], Array]]:
        """Yield contacts that press most at the same output, and what contact takes there; obstacles are put there."""
        peaks = {k: index for k, (_, index) in self._run.peaks.items()}
        for index in sorted({*peaks.values()}):
            self._contact.place(index * self._run.interval)
            yield {k for k, own in peaks.items() if own == index}, self._run.met(index)

    def better_points(self) -> list[tuple[int, int]] | None:
        """Return points of each pass with which patches are seen that had too few; None where all have enough."""
        before = self._contact.points
        for chosen, displacement in self._peaks():
            self._contact.see_better(displacement, between=False, chosen=chosen)
        return None if self._contact.points == before else self._contact.points

    def doubts(self) -> list[str]:
        """Return what is not to be trusted of the contacts, a line for each."""
        found: dict[int, result.ContactResult] = {}
        for chosen, displacement in self._peaks():
            results = self._contact.results(displacement, check=True)
            found |= {k: results[k] for k in chosen}
        return result.doubts(self._model, found, moving=True)
