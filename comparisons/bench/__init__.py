"""Study ``bench``: spring, blade and biceps against the fastest of every program that is here, at the same errors.

Spring and blade: dolfinx, of this Python and of others that are named, NGSolve and CalculiX, each along families of
meshes that were tuned for it; the fastest of each within an error, which keeps it on finer meshes, is measured again in
turn with isorod.  Biceps: explicit dynamics of dolfinx alone; CalculiX and NGSolve have no contracting fibres.
"""

from collections.abc import Sequence

from comparisons.bench import biceps, rods
from comparisons.measure import opponents
from comparisons.measure.study import Run
from isorod import options

# Our share of the time of the best of all that is asked for, by scene and error: one part in so many.
GOALS = {
    ("spring", 1e-3): 60,
    ("blade", 5e-3): 15,
    ("blade", 5e-4): 80,
    ("biceps", 1e-2): 80,
}


def run(study: Run, others: Sequence[str] = ()) -> None:
    """Run the study and append its records; ``others`` are interpreters whose dolfinx is measured too."""
    options.initialize([])
    here, absent = opponents.here()
    study.record(
        "opponents", {"here": here, "absent": absent, "goals": [[*key, share] for key, share in GOALS.items()]}
    )
    scenes = [rods.Spring(study.level, here, others), rods.Blade(study.level, here, others)]
    with study.progress(sum(scene.steps for scene in scenes) + biceps.steps(study.level)) as steps:
        for scene in scenes:
            scene.run(study, steps)
        biceps.run(study, steps)
