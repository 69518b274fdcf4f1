"""Harmonic response in an input file: modes, ``*STEADY STATE DYNAMICS``, loads that swing or the inertia of a base.

Supports that are shaken are at rest in the frame that moves with them, where ``*DLOAD,GRAV`` is what acts:
displacements are relative to the base, as in isorod.
"""

import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from isorod.errors import InputError
from isorod.harmonic import solve
from isorod.harmonic.drive import driven, relaxing
from isorod.harmonic.frequencies import Span
from isorod.model.load import Weight
from isorod.model.model import Model
from meshes import abaqus
from meshes.mesh import Index, Mesh

# Frequencies between two natural ones, and by what factor they concentrate at these.
_BETWEEN = "20,3."

# A node is at a place that is measured within this fraction of the mesh's size.
_SAME = 1e-9

# From this fraction of the largest amplitude on there is a note on what modes leave out.
_REPORTED = 1e-3


class Swing:
    """A harmonic analysis: its loads and frequencies.

    Attributes
    ----------
    still, swinging
        The model with what is static, and with the loads that swing; None where supports are shaken.
    modes
        How many modes CalculiX is to find.
    notes
        A line each.
    """

    def __init__(self, scene: Any, model: Model, settings: dict[str, Any]) -> None:
        self.scene, self._settings = scene, settings
        damping = settings.get("damping")
        if relaxing(model):
            raise InputError("harmonic response of viscoelastic laws is not written to .inp")
        if damping is None or damping.structural or (damping.ratio and any(damping.rayleigh)):
            raise InputError(
                "damping: one of ratio and rayleigh is written to .inp; no sum of both, nothing structural"
            )
        if settings.get("base_displacement"):
            raise InputError("base_displacement: is not written to .inp; base, the acceleration, is")
        self.base = np.array(settings.get("base") or np.zeros(3), dtype=float)
        drive = driven(model, settings.get("base"), None, settings.get("loads"))
        self.still, self.swinging = drive.still, None if self.base.any() else drive.swinging
        if self.swinging is not None and not all(isinstance(one, Weight) for one in self.still.loads):
            raise InputError("loads: some that swing beside others that are static are not written to .inp")
        self._model = model
        self.notes: list[str] = []

    def find(self) -> Iterator[str]:
        """Find how many modes it takes, and yield which measures these alone, as CalculiX has them, are off in."""
        response = solve(self._model, **self._settings)
        self.modes = len(response.modes.frequencies)
        alone = response.coordinates.copy()
        alone[:, self.modes :] = 0.0
        with warnings.catch_warnings():
            # Of stresses, which `isorod run` prints.
            warnings.simplefilter("ignore")
            measured, measured_alone = (
                self.scene.measure(one)["response"] for one in (response, replace(response, coordinates=alone))
            )
        for name, one in measured.items():
            off = np.abs(measured_alone[name]["amplitude"] - one["amplitude"]).max() / max(
                one["amplitude"].max(), 1e-300
            )
            if off > _REPORTED:
                yield f"{name}: modes alone, which CalculiX takes, are {100.0 * off:.2g} % of the largest amplitude off"

    def steps(self, modes: int, loads: list[str], before: list[str] | None, printed: list[str]) -> Iterator[str]:
        """Yield the steps of responses, behind that of modes.

        Parameters
        ----------
        modes
            How many there are.
        loads, before
            Lines of the loads that swing, and of those of a static step before, None if there is none.
        printed
            Sets of nodes whose displacements are asked for.
        """
        asked, damping = self._settings["frequencies"], self._settings["damping"]
        spans = [f"{asked.first:.12g},{asked.last:.12g},{_BETWEEN}"] if isinstance(asked, Span) else []
        for span in spans or [f"{one:.12g},{one:.12g},2" for one in np.unique(asked)]:
            yield from ["** Response: real parts, then imaginary ones, relative to supports"]
            # As that of the modes.
            yield from ["*STEP" if before is None else "*STEP,PERTURBATION", "*STEADY STATE DYNAMICS", span]
            if damping.ratio:
                yield from ["*MODAL DAMPING", f"1,{modes},{damping.ratio:.12g}"]
            else:
                alpha, beta = damping.rayleigh
                yield from ["*MODAL DAMPING,RAYLEIGH", f",,{alpha:.12g},{beta:.12g}"]
            # Loads of a step before would swing too.
            yield from sorted({f"{line.split(',')[0]},OP=NEW" for line in before or [] if line.startswith("*")})
            yield from loads
            if self.base.any():
                size = float(np.linalg.norm(self.base))
                direction = ",".join(f"{one:.12g}" for one in 0.0 - self.base / size)
                yield from ["*DLOAD", f"{abaqus.ALL_ELEMENTS},GRAV,{size:.12g},{direction}"]
            for title in printed:
                yield from [f"*NODE PRINT,NSET={title}", "U"]
            yield "*END STEP"


def places(scene: Any, model: Model, mesh: Mesh, number: Index) -> Iterator[tuple[str, int]]:
    """Yield the names of measures of points, and the numbers of nodes that are there, 0 where none is in the file."""
    for name, asked in scene.content["measure"].items():
        rod = asked.get("displacement", asked.get("acceleration"))
        if rod is None:
            continue
        axis = model.bodies[scene.rod_names().index(rod)].space.rod
        place = axis.points([asked.get("xi", (0.0, 0.0))], [asked.get("u", axis.axis.breaks[-1])])[0]
        far = np.linalg.norm(mesh.points - place, axis=1)
        yield f"measure {name}", int(number[far.argmin()]) if far.min() < _SAME * np.ptp(mesh.points) else 0
