"""Study ``laws``: every law of isorod's beside finite elements of the same stored energy, on rods of several kinds."""

from collections.abc import Mapping, Sequence
from typing import Any

from comparisons.measure import convergence
from comparisons.measure.study import Run
from comparisons.measure.timing import Clock
from comparisons.report.html import markdown
from isorod import options
from isorod.errors import InputError, SolveError
from isorod.output.results import write_beside

# Levels of the meshes (`comparisons.laws.scenes.Scene.mesh`) of bricks of 27 nodes, extrapolated where there are three.
MESHES = {"quick": (2, 3), "full": (2, 3, 4)}

# How far a law may be from finite elements, relative; how far finite elements may be from their own limit is beside it.
WANTED = 1e-3

TABLE = "laws.md"
HEAD = (
    "law",
    "scene",
    "",
    "isorod",
    "finite elements",
    "they tell to",
    "difference",
    "orders of Newton's method",
    "s",
    "s of finite elements",
)


def run(study: Run, laws: Sequence[str] = (), scenes: Sequence[str] = ()) -> None:
    """Solve scenes with laws (all where none is named) both ways; record each pair, and write the table too.

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
    found = []
    with study.progress(len(pairs)) as steps:
        for law, scene in pairs:
            with steps.step(f"{law}, {scene}"):
                found.append(study.record("pair", pair(law, scene, MESHES[study.level])))
    text = markdown(HEAD, [row for record in found for row in rows(record)])
    write_beside(study.folder / TABLE, lambda where: where.write_text(text + "\n"))


def pair(law: str, scene: str, levels: Sequence[int]) -> dict[str, Any]:
    """Return the record of a scene with a law: what both programs find, and how long they take."""
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
    told = [one.measure(solution) for solution in meshes]
    quantities = []
    for name, value in one.measure(own).items():
        limit = convergence.extrapolate([1.0 / level for level in levels], [found[name] for found in told])
        quantities.append(
            {
                "name": name,
                "isorod": value,
                "meshes": [found[name] for found in told],
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


def rows(record: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the rows of the table of a pair, columns as in ``HEAD``."""
    if "failure" in record:
        return [(record["law"], record["scene"], record["failure"], *[""] * (len(HEAD) - 3))]
    seconds = record["seconds"]
    orders = " ".join(f"{one:.1f}" for one in record["newton_orders"])
    times = f"{seconds['isorod']:.2g}", f"{seconds['finite elements'][-1]:.2g}"
    return [
        (
            record["law"],
            record["scene"],
            one["name"],
            f"{one['isorod']:.6g}",
            f"{one['limit']:.6g}",
            f"{100.0 * one['uncertainty']:.2g} %",
            f"{100.0 * one['difference']:.2g} %",
            orders,
            *times,
        )
        for one in record["quantities"]
    ]


def agrees(record: Mapping[str, Any]) -> bool:
    """Whether all that is compared of a pair is within `WANTED`."""
    return "failure" not in record and all(abs(one["difference"]) <= WANTED for one in record["quantities"])
