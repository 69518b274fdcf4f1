"""Study ``laws``: every law of isorod's beside finite elements of the same stored energy, on rods of several kinds."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from comparisons.measure import convergence
from comparisons.measure.study import Run
from comparisons.measure.timing import Clock
from comparisons.report.html import columns, markdown
from isorod import options
from isorod.errors import InputError, SolveError
from isorod.output.results import write_beside

# Levels of the meshes (`comparisons.laws.scenes.Scene.mesh`) of bricks of 27 nodes, extrapolated where there are three.
MESHES = {"quick": (2, 3), "full": (2, 3, 4)}

# How far a law may be from finite elements, relative; how far finite elements may be from their own limit is beside it.
TOLERANCE = 1e-3

TABLE = "laws.md"


def run(study: Run, laws: Sequence[str] = (), scenes: Sequence[str] = ()) -> None:
    """Solve scenes with laws (all where none is named) by both methods; record each pair, and write the table too.

    Raises
    ------
    InputError
        If a law or a scene is none of `comparisons.laws.scenes`, or the law has no such scene.
    """
    options.initialize([])
    from comparisons.laws.scenes import LAWS, SCENES, scenes_of

    for word, given, known in (("law", laws, LAWS), ("scene", scenes, SCENES)):
        unknown = [name for name in given if name not in known]
        if unknown:
            raise InputError(f"--{word} {unknown[0]}: need {', '.join(known)}")
    pairs = []
    for law in laws or LAWS:
        taken = [scene for scene in scenes or SCENES if scene in scenes_of(law)]
        if laws and not taken:
            raise InputError(f"--scene {scenes[0]}: {law} is compared on {', '.join(scenes_of(law))} alone")
        pairs += [(law, scene) for scene in taken]
    records = []
    with study.progress(len(pairs)) as steps:
        for law, scene in pairs:
            with steps.step(f"{law}, {scene}"):
                records.append(study.record("pair", pair(law, scene, MESHES[study.level])))
    text = markdown(*table(records))
    write_beside(study.folder / TABLE, lambda where: where.write_text(text + "\n"))


def pair(law: str, scene: str, levels: Sequence[int]) -> dict[str, Any]:
    """Return the record of a scene with a law: results and times of both programs."""
    from comparisons.fem.rods import solve
    from comparisons.laws import scenes
    from isorod import statics

    one = scenes.SCENES[scene]
    record: dict[str, Any] = {"law": law, "scene": scene, "title": one.title}
    try:
        model = one.model(scenes.LAWS[law](), "mixed" if law.startswith(scenes.INCOMPRESSIBLE) else "displacement")
        clock = Clock()
        own = statics.solve(model, load_steps=scenes.STEPS)
        clock.lap("isorod")
        meshes = [solve(model, one.mesh(level), "statics", load_steps=scenes.STEPS) for level in levels]
    except SolveError as problem:
        return record | {"failure": str(problem)}
    measured = [one.measure(solution) for solution in meshes]
    quantities = []
    for name, value in one.measure(own).items():
        limit = convergence.extrapolate([1.0 / level for level in levels], [values[name] for values in measured])
        quantities.append(
            {
                "name": name,
                "isorod": value,
                "meshes": [values[name] for values in measured],
                "limit": limit.value,
                "order": limit.order,
                "uncertainty": limit.distance / abs(limit.value),
                "difference": value / limit.value - 1.0,
            }
        )
    return record | {
        "quantities": quantities,
        "newton_orders": convergence.newton_orders(own.residual_norms),
        "unknowns": int(own.displacement.size),
        "dofs": [solution.dofs for solution in meshes],
        "seconds": {
            "isorod": clock.seconds["isorod"],
            "finite elements": [sum(solution.seconds.values()) for solution in meshes],
        },
    }


def table(records: Iterable[Mapping[str, Any]]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return head and rows of the table of pairs: each quantity's, or why there is none."""
    shown: dict[str, Callable[[Any], object]] = {
        "law": lambda row: row["law"],
        "scene": lambda row: row["scene"],
        "": lambda row: row.get("failure") or row["name"],
        "isorod": _if_solved(lambda row: f"{row['isorod']:.6g}"),
        "finite elements": _if_solved(lambda row: f"{row['limit']:.6g}"),
        "converged to": _if_solved(lambda row: f"{100.0 * row['uncertainty']:.2g} %"),
        "difference": _if_solved(lambda row: f"{100.0 * row['difference']:.2g} %"),
        "orders of Newton's method": _if_solved(lambda row: " ".join(f"{one:.1f}" for one in row["newton_orders"])),
        "s": _if_solved(lambda row: f"{row['seconds']['isorod']:.2g}"),
        "s of finite elements": _if_solved(lambda row: f"{row['seconds']['finite elements'][-1]:.2g}"),
    }
    return columns([one | row for one in records for row in one.get("quantities", [{}])], shown)


def _if_solved(of: Callable[[Any], str]) -> Callable[[Any], str]:
    return lambda row: "" if "failure" in row else of(row)


def agrees(record: Mapping[str, Any]) -> bool:
    """Whether all that is compared of a pair is within `TOLERANCE`."""
    return "failure" not in record and all(abs(one["difference"]) <= TOLERANCE for one in record["quantities"])
