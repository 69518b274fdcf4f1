"""Resolution of contact patches in a motion; loaded by models that have contacts.

Each contact is evaluated at the output of its largest force: before and after, patches are smaller.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from isorod.arrays import Array, Index
from isorod.contact import result
from isorod.contact.operator import ContactOperator
from isorod.dynamics.run import Run

# Fraction of the largest force above which the place of a patch is compared, and that of the load allowed elsewhere.
_PRESSES, _ELSEWHERE = 0.5, 0.2


class PeakContacts:
    """The contacts of a motion at their largest forces.

    Parameters
    ----------
    run
        The motion, at its end.
    """

    def __init__(self, run: Run) -> None:
        self._run, self._model = run, run.system.model
        self._contact = ContactOperator(self._model, run.system.ranks.communicator, in_motion=True)
        self._contact.look(run.system.points)
        self._forces = np.array(run.rows["contact_forces"])

    def _peaks(self) -> Iterator[tuple[Index, Array]]:
        """Yield contacts with largest forces at the same output, and the displacement there; obstacles are placed."""
        peaks = self._forces.argmax(axis=0)
        for index in np.unique(peaks).tolist():
            yield np.flatnonzero(peaks == index), self._displacement_at(index)

    def _displacement_at(self, index: int) -> Array:
        self._contact.place(index * self._run.interval)
        return self._run.contact_displacement(index)

    def better_points(self) -> list[tuple[int, int]] | None:
        """Return points of each pass that resolve all patches; None where the present ones do."""
        before = self._contact.points
        for chosen, displacement in self._peaks():
            self._contact.increase_points(displacement, between=False, chosen=chosen.tolist())
        return None if self._contact.points == before else self._contact.points

    def results(self) -> list[result.ContactResult]:
        """Return the result of each contact at its largest force."""
        at_peaks: dict[int, result.ContactResult] = {}
        for chosen, displacement in self._peaks():
            outcome = self._contact.results(displacement, check=True)
            at_peaks |= {k: replace(outcome[k], wanders=self._wanders(k, outcome[k].pressure > 0.0)) for k in chosen}
        return [at_peaks[k] for k in range(len(at_peaks))]

    def _wanders(self, k: int, pressed: Array) -> bool:
        """Return whether a contact also presses at other points than those ``pressed`` at its largest force."""
        forces = self._forces[:, k]
        outputs = np.flatnonzero((forces > 0.0) & (forces >= _PRESSES * forces.max()))
        packed = self._contact.packed
        (there,) = (points for n, (_, _, points) in enumerate(result.of_contacts(self._model, packed)) if n == k)
        for index in outputs[[0, -1]].tolist() if outputs.size else []:
            self._contact.forces(self._displacement_at(index))
            loads = packed.areas[there] * packed.states["pressure"][there]
            if loads[~pressed].sum() > _ELSEWHERE * loads.sum():
                return True
        return False

    def doubts(self, results: list[result.ContactResult]) -> list[str]:
        """Return warnings on unreliable `results`, a line each."""
        return result.doubts(self._model, dict(enumerate(results)), moving=True)
