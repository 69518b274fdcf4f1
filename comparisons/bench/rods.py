"""Spring and blade: error against run time of every program, on meshes of the very same geometry."""

from collections.abc import Mapping, Sequence
from itertools import chain

from comparisons import blade, spring
from comparisons.fem.presets import blade as fem_blade
from comparisons.fem.presets import spring as fem_spring
from comparisons.fem.presets.family import Family
from comparisons.measure.scene import Scene
from comparisons.measure.work import AS_RUN, Curve, fem_curves, with_others
from comparisons.ngsolve import presets as ngsolve

TARGETS = {
    "spring": {"quick": (1e-2, 1e-3), "full": (1e-2, 1e-3, 1e-4)},
    "blade": {"quick": (5e-3, 5e-4), "full": (1e-2, 5e-3, 1e-3, 5e-4)},
}

Known = Mapping[float, Sequence[str]]


def scenes(level: str, here: Sequence[str], others: Sequence[str]) -> list[Scene]:
    """Return spring and blade.

    Parameters
    ----------
    level
        Of the study.
    here
        Programs beside dolfinx (keys of `comparisons.measure.work.MODULES`).
    others
        Interpreters whose dolfinx is measured too.
    """
    # At quick level the families of the studies that are the fastest at some error.
    wires = {"quick": _without(fem_spring.QUICK, "Q2 bricks", "P2 tetrahedra"), "full": fem_spring.FULL}
    blades = {"quick": _without(fem_blade.QUICK, "P2 tetrahedra"), "full": fem_blade.FULL}
    more = {"spring": ngsolve.SPRING, "blade": ngsolve.BLADE}
    result = []
    for name, measured, study, best, families, reference in (
        ("spring", "force", spring, fem_spring.BEST, wires, fem_spring.CONVERGED[level]),
        # An error of 0.05 % takes the full level's.
        ("blade", "frequencies", blade, fem_blade.BEST, blades, fem_blade.CONVERGED["full"]),
    ):
        known = {target: {"cylindrical": study.BEST[target], "fem": best[target]} for target in TARGETS[name][level]}
        curves = every(study.CURVES[level], families[level], known, others)
        if "ngsolve" in here:
            curves += fem_curves(more[name][level], "ngsolve")
        finer = study.FINER | {"ngsolve": study.FINER["fem"]}
        result.append(Scene(name, (measured,), reference, curves, with_default(known), finer))
    return result


def every(
    ours: Sequence[Curve],
    families: Sequence[Family],
    known: Mapping[float, Mapping[str, Sequence[str]]],
    others: Sequence[str],
) -> tuple[Curve, ...]:
    """Return the curves of isorod and dolfinx; every level measures the fastest known runs of either."""
    sides = {"cylindrical": [curve for curve in ours if curve.method == "cylindrical"], "fem": [*fem_curves(families)]}
    for method, curves in sides.items():
        measured = {arguments for curve in curves for arguments in curve.arguments}
        fast = dict.fromkeys(arguments for target in known.values() for arguments in target[method])
        missing = tuple(arguments for arguments in fast if arguments not in measured)
        if missing:
            curves.append(Curve("known to be fast", method, missing))
    return (*sides["cylindrical"], AS_RUN, *with_others(sides["fem"], others))


def with_default(known: Mapping[float, Mapping[str, Sequence[str]]]) -> Known:
    """Return the fastest known runs of all sides, and isorod's default."""
    return {target: (*AS_RUN.arguments, *chain.from_iterable(sides.values())) for target, sides in known.items()}


def _without(families: Sequence[Family], *labels: str) -> list[Family]:
    return [family for family in families if family.label not in labels]
