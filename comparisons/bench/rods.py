"""Spring and blade: error against run time of every program, on meshes of the very same geometry."""

from collections.abc import Mapping, Sequence

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
    # Of the quick families of the studies, those that come first somewhere.
    wires = {"quick": _without(fem_spring.QUICK, "Q2 bricks", "P2 tetrahedra"), "full": fem_spring.FULL}
    blades = {"quick": _without(fem_blade.QUICK, "P2 tetrahedra"), "full": fem_blade.FULL}
    more = {"spring": ngsolve.SPRING, "blade": ngsolve.BLADE}
    found = []
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
        found.append(Scene(name, (measured,), reference, curves, with_default(known), finer))
    return found


def every(
    ours: Sequence[Curve],
    families: Sequence[Family],
    known: Mapping[float, Mapping[str, Sequence[str]]],
    others: Sequence[str],
) -> tuple[Curve, ...]:
    """Return the curves of isorod and dolfinx; every level measures what is known to be fastest of either."""
    sides = {"cylindrical": [one for one in ours if one.method == "cylindrical"], "fem": [*fem_curves(families)]}
    for method, curves in sides.items():
        there = {one for curve in curves for one in curve.arguments}
        fast = dict.fromkeys(one for target in known.values() for one in target[method] if one not in there)
        if fast:
            curves.append(Curve("known to be fast", method, tuple(fast)))
    return (*sides["cylindrical"], AS_RUN, *with_others(sides["fem"], others))


def with_default(known: Mapping[float, Mapping[str, Sequence[str]]]) -> Known:
    """Return what is known to be fast of all sides, and isorod with nothing chosen."""
    return {
        target: (*AS_RUN.arguments, *(one for side in sides.values() for one in side))
        for target, sides in known.items()
    }


def _without(families: Sequence[Family], *labels: str) -> list[Family]:
    return [one for one in families if one.label not in labels]
