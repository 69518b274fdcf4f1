"""Study ``bench``: rods and biceps against the fastest of every program that is here, at the same errors.

Spring and blade: dolfinx, of this Python and of others that are named, and NGSolve, each along families of meshes that
were tuned for it; the fastest of each within an error, which keeps it on finer meshes, is measured again in turn with
isorod.  Rods with a hole or in layers: dolfinx alone.  Biceps: explicit dynamics of dolfinx alone; NGSolve has no
contracting fibres.
"""

import os
from collections.abc import Sequence
from importlib import util

from comparisons.bench import biceps, hollow, rods
from comparisons.measure.study import Run
from isorod import options


def opponents() -> tuple[list[str], dict[str, str]]:
    """Return the programs beside dolfinx that are here (keys of `comparisons.measure.work.MODULES`).

    And by the name of each that is not, what is missing.
    """
    if util.find_spec("ngsolve") is None:
        return [], {"ngsolve": "this Python has no ngsolve; docker/opponents installs it"}
    return ["ngsolve"], {}


def run(study: Run, others: Sequence[str] = (), only: Sequence[str] = ()) -> None:
    """Run the study and append its records.

    ``others`` are interpreters whose dolfinx is measured too, ``only`` are scenes of rods to measure alone.
    """
    options.initialize([])
    here, absent = opponents()
    # What else the machine does: times are worth little beside it.
    study.record("opponents", {"here": here, "absent": absent, "load": os.getloadavg()[0]})
    scenes = [*rods.scenes(study.level, here, others), *hollow.scenes(others)]
    scenes = [scene for scene in scenes if scene.name in only or not only]
    with study.progress(sum(scene.steps for scene in scenes) + (0 if only else biceps.steps(study.level))) as steps:
        for scene in scenes:
            scene.run(study, steps)
        if not only:
            biceps.run(study, steps)
