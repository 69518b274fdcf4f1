"""Study ``joints``: rods with blocks, coupled, beside finite elements of them as one solid: error against time.

Of finite elements as one solid there are bricks whose columns go on in the blocks, and tetrahedra by gmsh, of degree 2.
The converged value is that of bricks, extrapolated from two meshes of which the second is twice as fine where the
joint's edges are: there stresses are singular, and errors fall with the size of cells.
"""

import gc
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from comparisons.fem.runs import provenance
from comparisons.joints import whole
from comparisons.joints.bushes import Spring
from comparisons.joints.columns import Screw, Tendon
from comparisons.joints.scene import Outcome, Scene, Sizes
from comparisons.measure.records import Record
from comparisons.measure.study import Run, Steps

Array = NDArray[np.float64]

# Within what runs have to be.
TARGETS = (0.01, 0.005)

# Runs of each configuration, the first one cold; of those that take longer than so many seconds one.
REPEAT, LONG = 2, 20.0

# How often the fastest of both sides are measured again, in turn.
TURNS = 3


@dataclass(frozen=True)
class Work:
    """A method to solve a scene.

    Attributes
    ----------
    side
        ``"one solid"`` or ``"coupled"``.
    shape
        Of the cells.
    sizes
        Of the cells.
    space
        Of the rod, where it is coupled: what is chosen by hand.
    """

    side: str
    shape: str
    sizes: Sizes
    space: dict[str, int] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """A description in words."""
        rod = ", ".join(f"{name} {value}" for name, value in self.space.items()) or "default rod"
        cells = "bricks" if self.shape == "hexahedron" else "tetrahedra"
        near = f"{self.sizes.near:g} to {self.sizes.far:g}"
        if self.shape == "hexahedron":
            near += f", {self.sizes.around} round"
        return f"{cells} {near}, wire {self.sizes.wire:g}" if self.side == "one solid" else f"{cells} {near}; {rod}"

    def ready(self, scene: Scene) -> Callable[[], Outcome]:
        """Make the meshes, and return the function that solves on them."""
        if self.side == "one solid":
            mesh = scene.bricks(self.sizes) if self.shape == "hexahedron" else scene.tetrahedra(self.sizes)

            def one() -> Outcome:
                solution = whole.solve(mesh, scene.problem())
                return Outcome(scene.of_whole(solution), (0, solution.unknowns), solution.seconds)

            return one
        space, meshes = scene.space(**self.space), scene.blocks(self.sizes, self.shape)
        return lambda: scene.coupled(space, meshes)._replace(solution=None)


@dataclass(frozen=True)
class Subject:
    """A scene with its runs, coarse to fine on each side; ``converged`` are two meshes of one solid."""

    name: str
    title: str
    scene: Scene
    work: Sequence[Work]
    converged: tuple[Sizes, Sizes]


def _one(shape: str, *sizes: tuple[Any, ...]) -> list[Work]:
    return [Work("one solid", shape, Sizes(*one)) for one in sizes]


def _coupled(shape: str, *sizes: tuple[Any, ...], **space: int) -> list[Work]:
    return [Work("coupled", shape, Sizes(*one), space) for one in sizes]


BRICKS, TETRAHEDRA = "hexahedron", "tetrahedron"

# Wires whose elements are those of the centre line, and rods of few elements.
_WIRE: dict[str, int] = {"section_degree": 2, "elements": 62, "degree": 5, "continuity": 4}
_SHORT: dict[str, int] = {"section_degree": 3, "elements": 3, "degree": 4}

SUBJECTS = (
    Subject(
        "spring",
        "six coils of wire whose legs are bonded in two rubber blocks, pushed together",
        Spring(),
        [
            *_one(BRICKS, (1.5, 2.5, 6.0, 4), (1.0, 2.0, 5.0, 4), (0.7, 2.0, 5.0, 4), (0.5, 1.5, 4.0, 4)),
            *_one(BRICKS, (1.0, 2.5, 5.0, 8), (1.0, 2.5, 4.0, 8), (0.7, 2.0, 4.0, 8), (0.7, 2.0, 3.0, 8)),
            *_coupled(BRICKS, (2.0, 3.0, 8.0, 4), (1.0, 2.5, 8.0, 4), (0.7, 2.0, 8.0, 4), **_WIRE),
            *_coupled(BRICKS, (1.5, 3.0, 8.0, 8), (1.0, 2.5, 8.0, 8), (0.7, 2.0, 8.0, 8), (0.5, 1.5, 8.0, 8), **_WIRE),
            *_coupled(TETRAHEDRA, (0.7, 2.0), (0.5, 1.5), **_WIRE),
            *_coupled(BRICKS, (1.0, 2.5, 8.0, 8)),
        ],
        (Sizes(0.5, 1.5, 3.0, 8), Sizes(0.25, 1.5, 3.0, 8)),
    ),
    Subject(
        "tendon",
        "a tendon on bone, its end pulled aside",
        Tendon(),
        [
            *_one(BRICKS, (2.0, 8.0, 8.0, 4), (1.0, 6.0, 8.0, 4), (0.6, 6.0, 6.0, 4), (0.4, 4.0, 5.0, 4)),
            *_one(BRICKS, (1.5, 4.0, 4.0, 8), (1.0, 3.0, 3.0, 8), (0.7, 3.0, 3.0, 8), (0.5, 2.4, 2.5, 8)),
            *_one(TETRAHEDRA, (1.5, 4.0, 4.0), (1.0, 3.0, 3.0), (0.6, 2.4, 2.5), (0.4, 2.0, 2.0)),
            *_coupled(TETRAHEDRA, (3.0, 12.0), (3.0, 8.0), (2.0, 8.0), (2.0, 6.0), (1.5, 5.0)),
            *_coupled(BRICKS, (6.0, 12.0, 8.0, 4), (3.0, 8.0, 8.0, 4), (2.0, 8.0, 8.0, 8)),
            *_coupled(TETRAHEDRA, (3.0, 8.0), (2.0, 6.0), (1.5, 5.0), section_degree=3),
        ],
        (Sizes(0.5, 2.0, 2.0, 16, 2), Sizes(0.25, 2.0, 2.0, 16, 2)),
    ),
    Subject(
        "screw",
        "a screw bonded in the hole of a plate, pulled out of it",
        Screw(),
        [
            *_one(BRICKS, (0.7, 4.0, 3.0, 4), (0.5, 3.0, 3.0, 4), (0.3, 3.0, 3.0, 4), (0.2, 3.0, 3.0, 4)),
            *_one(BRICKS, (1.0, 3.0, 2.0, 8), (0.7, 3.0, 3.0, 8), (0.5, 3.0, 3.0, 8), (0.3, 3.0, 3.0, 8)),
            *_one(TETRAHEDRA, (1.0, 2.5, 2.0), (0.5, 3.0, 2.0), (0.3, 2.0, 2.0), (0.2, 1.5, 1.5)),
            *_coupled(BRICKS, (0.7, 4.0, 3.0, 4), (0.5, 3.0, 3.0, 4), (0.3, 3.0, 3.0, 4), (0.2, 3.0, 3.0, 4), **_SHORT),
            *_coupled(BRICKS, (1.0, 3.0, 2.0, 8), (0.7, 3.0, 3.0, 8), (0.5, 3.0, 3.0, 8), (0.2, 2.0, 2.0, 8), **_SHORT),
            *_coupled(TETRAHEDRA, (0.5, 3.0), (0.3, 2.0), **_SHORT),
            *_coupled(BRICKS, (0.7, 3.0, 3.0, 8), (0.5, 3.0, 3.0, 8), (0.3, 2.0, 2.0, 8)),
        ],
        (Sizes(0.3, 1.0, 0.8, 16, 2), Sizes(0.15, 1.0, 0.8, 16, 2)),
    ),
)


def run(study: Run) -> None:
    """Run every scene and append the records."""
    count = sum(len(one.work) + 2 + len(TARGETS) for one in SUBJECTS)
    with study.progress(count) as steps:
        for subject in SUBJECTS:
            _Comparison(study, steps, subject).run()


@dataclass(frozen=True)
class _Comparison:
    study: Run
    steps: Steps
    subject: Subject

    def run(self) -> None:
        """Record the converged values, all work, and the fastest of both sides within each target."""
        meshes = []
        for sizes in self.subject.converged:
            with self.steps.step(f"{self.subject.name}: converged, bricks of {sizes.near:g} to {sizes.far:g}"):
                meshes.append(self._measured(Work("one solid", BRICKS, sizes), 1))
        coarse, fine = (np.array(one["values"]) for one in meshes)
        limit = 2.0 * fine - coarse
        subject = {"scene": self.subject.name, "title": self.subject.title, "names": self.subject.scene.quantities}
        uncertainty = float(np.abs(fine / limit - 1.0).max())
        self._record("converged", subject | {"values": limit.tolist(), "uncertainty": uncertainty, "meshes": meshes})
        done = []
        for work in self.subject.work:
            with self.steps.step(f"{self.subject.name}, {work.side}: {work.label}"):
                record = self._measured(work, REPEAT)
                record["error"] = float(np.abs(np.array(record["values"]) / limit - 1.0).max())
                done.append((work, self._record("work", subject | record)))
        for target in TARGETS:
            with self.steps.step(f"{self.subject.name}: side by side within {100 * target:g} %"):
                self._beside(done, target)

    def _beside(self, done: Sequence[tuple[Work, Record]], target: float) -> None:
        """Measure the fastest of both sides within a target again, in turn, and record them."""
        every = ("coupled", None), ("one solid", BRICKS), ("one solid", TETRAHEDRA)
        best = [
            fastest([pair for pair in done if pair[0].side == side and shape in (None, pair[0].shape)], target)
            for side, shape in every
        ]
        chosen = [pair for pair in best if pair is not None]
        ready = [work.ready(self.subject.scene) for work, _ in chosen]
        times: list[list[float]] = [[] for _ in chosen]
        for _ in range(1 + TURNS):
            for solve, own in zip(ready, times, strict=True):
                own.append(_once(solve).seconds)
        for (_, record), own in zip(chosen, times, strict=True):
            self._record("confirm", record | {"target": target, "turns": own[1:], "seconds": min(own[1:])})

    def _measured(self, work: Work, repeat: int) -> dict[str, Any]:
        solve, times = work.ready(self.subject.scene), []
        for _ in range(repeat):
            outcome = _once(solve)
            times.append(outcome.seconds)
            if outcome.seconds > LONG:
                break
        return {
            "side": work.side,
            "label": work.label,
            "shape": work.shape,
            "sizes": work.sizes._asdict(),
            "space": work.space,
            "values": outcome.values.tolist(),
            "unknowns": list(outcome.unknowns),
            "seconds": min(times[1:] or times),
        }

    def _record(self, part: str, values: dict[str, Any]) -> Record:
        return self.study.record(part, provenance() | values)


def _once(solve: Callable[[], Outcome]) -> Outcome:
    """Return the outcome of a call, after the garbage of the last one is collected."""
    gc.collect()
    return solve()


def fastest(done: Sequence[tuple[Work, Record]], target: float) -> tuple[Work, Record] | None:
    """Return the fastest that is within a target with all that are nowhere coarser, or nothing.

    On coarse meshes errors of the section and of the axis can cancel.
    """

    def is_finer(work: Work, than: Work) -> bool:
        alike = (work.side, work.shape, work.space) == (than.side, than.shape, than.space)
        return (
            alike
            and work.sizes.around >= than.sizes.around
            and all(a <= b for a, b in zip(work.sizes[:3], than.sizes[:3], strict=True))
        )

    held = [
        (work, record)
        for work, record in done
        if all(other["error"] <= target for one, other in done if is_finer(one, work))
    ]
    return min(held, key=lambda pair: pair[1]["seconds"], default=None)
