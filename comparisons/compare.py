"""Study ``compare``: any scene, solved by both methods: errors against run time, fields, pictures.

What is compared with is the finite elements' own limit: of each number that the scene measures three meshes are
extrapolated.  Fields are compared with those of the finest mesh, at its nodes, and stresses that nothing measures at
surfaces, away from edges (`isorod.checks.stresses`); the default's also with those of isorod's own finest space.
"""

import os
import re
import shlex
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from comparisons import COMPARED
from comparisons.fem import known
from comparisons.measure import distance, quantities, timing
from comparisons.measure.records import Record
from comparisons.measure.rod import find, solve
from comparisons.measure.sampled import Sample
from comparisons.measure.study import Run, Steps
from comparisons.measure.variants import BODIES, DEFAULT, Variant, variants
from comparisons.report import rod_pictures
from isorod import options, scenes
from isorod.arrays import Array
from isorod.errors import InputError, SolveError
from isorod.files.document import ALLOWED
from isorod.output import results
from isorod.output.words import duration
from meshes import cuts, rods
from meshes.joined_mesh import body_file

# What names of files are better without.
_UNFIT = re.compile(r"[^\w.-]+")


class Most(NamedTuple):
    """How large a mesh may be, and how long its solution may take, extrapolated from the mesh before."""

    dofs: int
    seconds: float


# Meshes, each of so many times the cells of the coarsest in each direction; what is tried in the place of the last
# where that would be more than the level allows; how much more of it the second may have.
LEVELS, INSTEAD = (1, 2, 4), 3
SECOND = 2.0
MOST = {"quick": Most(150_000, 180.0), "full": Most(600_000, 3600.0)}

# Power of the number of unknowns that run times grow with.
GROWTH = 1.5

# Degree of bricks, and of those of rods that bend so much along a layer of the coarsest mesh (`meshes.rods.locking`)
# that bricks of degree 2 are much too stiff.
DEGREE, BENT = 2, 3
MUCH = 2.0

# Of finite elements with more unknowns the bodies' meshes are not taken for isorod: a lateral surface that is tied to
# the facets of a plate took 13 GB on those of 67,000.
MOST_OF_BODIES = 30_000

# At full level more elements, by degree on the levels of the mesh, whose run times are measured.
MORE = {"quick": {}, "full": {1: (2, 4), 2: (2, 4), 3: (1, 2)}}

# Runs of each configuration, the first one cold: of isorod, and of meshes up to so many degrees of freedom, larger ones
# once.
REPEAT, REPEAT_COUPLED = 5, 2
REPEAT_MESH = {6_000: 4, 30_000: 2}


@dataclass(frozen=True)
class Subject:
    """The subject: a scene, the word that names it, its model, and the number of ranks."""

    word: str
    scene: Any
    model: Any
    ranks: int = 1

    @property
    def study(self) -> str:
        """Name of its study, and of the file of its records."""
        return f"{COMPARED}-{_UNFIT.sub('-', Path(self.word).stem)}"

    @cached_property
    def degree(self) -> int:
        """Degree of the finite elements; tetrahedra, of ties, have one alone, and contacts were tried with that."""
        if self.model.ties or self.model.solids or self.model.contacts:
            return DEGREE
        bent = max(rods.locking(cuts.cut(self.model, b)) for b in range(len(self.model.bodies)))
        return BENT if bent > MUCH else DEGREE


def subject(word: str, ranks: int = 1) -> Subject:
    """Return the scene of that name, or of the file, for so many ranks.

    Raises
    ------
    InputError
        If it is wrong, or one of those that finite elements do not solve here, with what can be done in its place.
    """
    if word == "biceps":
        raise InputError(
            "biceps: it moves, and presses on itself; its comparison is a study: python -m comparisons biceps"
        )
    scene = find(word, {})
    analysis = scenes.analyses(scene)[0]
    if analysis == "geometry":
        raise InputError(f"{word}: geometry alone, with nothing to solve; isorod run {word} tells its volume")
    if scene.cases:
        raise InputError(f"{word}: several load cases, of which none is compared; write one as a file of its own")
    options.initialize([])
    if MPI.COMM_WORLD.size > 1:
        raise InputError(
            f"compare: it starts the ranks of both programs itself; leave out mpiexec, and add --ranks "
            f"{MPI.COMM_WORLD.size}"
        )
    with scene.locating():
        model = scene.model()
        known.refuse_scene(scene, model)
    if ranks > 1 and model.solids:
        raise InputError(f"{word}: --ranks {ranks}: finite element bodies are compared on one rank alone; leave it out")
    return Subject(word, scene, model, ranks)


def main(word: str, level: str, folder: str, ranks: int = 1) -> str:
    """Compare a scene and append the records to a results folder, which is made when there are any.

    Returns the name of the study.
    """
    what = subject(word, ranks)
    study = Run(what.study, level, Path(folder))
    more = sum(len(levels) for degree, levels in MORE[study.level].items() if degree != what.degree)
    ours = 8 + (len(LEVELS) - 1 if what.model.solids else 0)
    with study.progress(len(LEVELS) + more + ours + 1) as steps, tempfile.TemporaryDirectory() as place:
        Comparison(study, steps, what, Path(place)).run()
    return study.study


@dataclass(frozen=True)
class _Solved:
    """A finite element run: the level of its mesh, its record, its fields."""

    level: int
    record: Record
    sample: Sample


class _Ours(NamedTuple):
    """A run of isorod: its record, and stresses at surfaces."""

    record: Record
    von_mises: Array | None


@dataclass(frozen=True)
class Comparison:
    """One comparison: the run with its records, its progress, the subject, and a folder for its fields."""

    study: Run
    steps: Steps
    what: Subject
    folder: Path

    def run(self) -> None:
        """Run finite elements first, which may refuse the scene; then isorod, coarser and finer than it chooses."""
        names = [*self.what.scene.units]
        meshes = self._meshes()
        finest = meshes[-1]
        values = [quantities.values(one.record, names) for one in meshes]
        reference = quantities.converged([1.0 / one.level for one in meshes], values)
        scene = self.what.scene
        stresses = list(scene.stresses)
        judge = distance.Judge(reference, finest.sample, names, stresses)
        entry = {"word": self.what.word, "title": scene.title, "units": scene.units, "ranks": self.what.ranks}
        self._record("scene", entry | {"name": scene_name(self.what), "analysis": scene.analysis, "stresses": stresses})
        self._record("converged", {"quantities": [vars(one) for one in reference], "degree": self.what.degree})
        for one in meshes:
            own = judge.of_mesh(one.record, one.sample)
            self._record("work", one.record | own)
        self._more(judge, finest)
        default = self._ours(judge, [one.level for one in meshes if one.record["dofs"] <= MOST_OF_BODIES])
        with self.steps.step("pictures"):
            solution, _ = solve(scene, scene.settings(), 1)
            # Of a motion that in the end.
            solution = solution[-1] if self._moves else solution
            rod_pictures.write(self.study, solution, (default, finest.record), finest.sample)
        self._record("end", {})

    def _meshes(self) -> list[_Solved]:
        """Return finite elements on nested meshes; too large ones are left out and recorded as such."""
        solved: list[_Solved] = []
        for level in LEVELS:
            fitting, dofs = self._fitting(solved, level)
            if fitting is None:
                continue
            with self.steps.step(f"finite elements of degree {self.what.degree}, mesh {fitting}"):
                try:
                    solved.append(self._mesh(fitting, dofs, self.what.degree))
                except timing.Failed as problem:
                    if len(solved) < 2:
                        mine = problem.last_line.startswith(f"{self.what.word}:")
                        where = "" if mine else f"{self.what.word}: finite elements: "
                        raise InputError(where + problem.last_line) from None
                    self._refuse("fem", _words(fitting, self.what.degree), problem.last_line)
        if len(solved) < 2:
            raise InputError(
                f"{self.what.word}: finite elements need {solved[0].record['dofs']:,} unknowns on the coarsest mesh, "
                f"and two meshes at least; --level full allows {MOST['full'].dofs:,}"
            )
        return solved

    def _fitting(self, solved: Sequence[_Solved], level: int) -> tuple[int | None, float]:
        """Return the level of a mesh, or the one in its place, that is not too large, or None, and how large it is."""
        if not solved:
            return level, 0.0
        last, most = solved[-1].record, MOST[self.study.level]
        for nearest in (level, INSTEAD) if level > INSTEAD else (level,):
            finer = (nearest / solved[-1].level) ** 3
            dofs, seconds = last["dofs"] * finer, last["seconds"]["total"] * finer**GROWTH
            # Without a second mesh there is nothing to compare with: it may be larger, and take however long it does.
            if (dofs <= most.dofs and seconds <= most.seconds) or (len(solved) < 2 and dofs <= SECOND * most.dofs):
                return nearest, dofs
            large = f"about {dofs:,.0f} unknowns and {duration(seconds)}"
            limit = f"at most {most.dofs:,} and {duration(most.seconds)}"
            self._refuse("fem", _words(nearest, self.what.degree), f"left out: {large}; {limit}")
        return None, 0.0

    def _mesh(self, level: int, dofs: float, degree: int) -> _Solved:
        file = self.folder / f"fem-{degree}-{level}.npz"
        arguments = _words(level, degree)
        repeat = next((count for most, count in REPEAT_MESH.items() if dofs <= most and not self._moves), 1)
        words = ["rods", self.what.word, *arguments, "--repeat", str(repeat), "--fields", str(file)]
        if self.what.model.solids:
            words += ["--bodies", str(self._bodies(level))]
        record = timing.run("comparisons.fem", words, self.what.ranks)
        cells = f"P{degree} tetrahedra" if record.get("shape") == "tetrahedron" else f"Q{degree} bricks"
        named = {"curve": cells, "label": f"mesh {level}", "arguments": " ".join(arguments)}
        return _Solved(level, record | named | {"sequence": True}, Sample.read(file, record.get("rigid", 0)))

    def _more(self, judge: distance.Judge, finest: _Solved) -> None:
        """Record finite elements of other degrees; tetrahedra, of one solid, have none."""
        if finest.sample.reference is not None:
            return
        for degree, levels in MORE[self.study.level].items():
            for level in levels if degree != self.what.degree else ():
                with self.steps.step(f"finite elements of degree {degree}, mesh {level}"):
                    try:
                        dofs = finest.record["dofs"] * (level * degree / (finest.level * self.what.degree)) ** 3
                        solved = self._mesh(level, dofs, degree)
                    except timing.Failed as problem:
                        self._refuse("fem", _words(level, degree), problem.last_line)
                        continue
                    self._record("work", solved.record | judge.of_mesh(solved.record, solved.sample))

    def _ours(self, judge: distance.Judge, levels: Sequence[int]) -> Record:
        """Record isorod's runs, those with bodies of finite elements' levels too; return that with nothing chosen."""
        judge.places.write(self.folder / "places.npz")
        # Where the bodies' meshes of other sizes are, from which scenes may read.
        os.environ[ALLOWED] = os.pathsep.join([str(self.folder), *filter(None, [os.environ.get(ALLOWED)])])
        first = self._variant(judge, Variant(DEFAULT, (), True))
        assert first is not None
        default = first.record
        chosen = variants(self.what.scene, self.what.model, default["discretisation"])
        runs = [run for one in chosen if (run := self._variant(judge, one)) is not None]
        for level in levels if self.what.model.solids else ():
            files = {one.name: body_file(self._bodies(level), one.name) for one in self.what.scene.bodies()}
            arguments = [word for name, file in files.items() for word in ("--set", f"solid.{name}.mesh={file}")]
            self._variant(judge, Variant(f"bodies {level}", tuple(arguments), True), BODIES)
        best = max(runs, key=lambda one: one.record["dofs"], default=first)
        if "stress" in default and best.record["dofs"] > default["dofs"]:
            own = judge.between(first.record, first.von_mises, best.record, best.von_mises)
            self._record("finer", {"label": best.record["label"], "dofs": best.record["dofs"], "stress": own})
        return default

    @property
    def _repeat(self) -> int:
        """How often isorod solves each."""
        return REPEAT_COUPLED if self.what.model.solids or self._moves else REPEAT

    @property
    def _moves(self) -> bool:
        """Whether it is a motion, whose steps are many."""
        return bool(self.what.scene.analysis == "dynamics")

    def _bodies(self, level: int) -> Path:
        """Return the folder of the bodies' meshes that are cut out of finite elements'."""
        folder = self.folder / f"bodies-{level}"
        folder.mkdir(exist_ok=True)
        return folder

    def _variant(self, judge: distance.Judge, variant: Variant, curve: str = "isorod") -> _Ours | None:
        file = self.folder / "ours.npz"
        asked = ["--at", str(self.folder / "places.npz"), "--fields", str(file)]
        with self.steps.step(f"isorod, {variant.label}"):
            try:
                # Estimates of coupled models take longer than these, and the page has that of the default alone.
                more = ["--estimate"] if variant.label == DEFAULT or not self.what.model.solids else []
                words = [self.what.word, *variant.arguments, "--repeat", str(self._repeat), *more, *asked]
                record = timing.run("comparisons.measure.rod", words, self.what.ranks)
            except timing.Failed as problem:
                if variant.label == DEFAULT:
                    raise SolveError(problem.last_line) from None
                self._refuse("cylindrical", variant.arguments, problem.last_line)
                return None
            with np.load(file) as arrays:
                fields = dict(arrays)
        # With the unknowns of bodies, which finite elements count too.
        record["dofs"] += 3 * sum(each["nodes"] for each in record.get("solids", ()))
        named = {"curve": curve, "label": variant.label, "arguments": shlex.join(variant.arguments)}
        own = judge.of_ours(record, fields)
        return _Ours(
            self._record("work", record | named | {"sequence": variant.sequence} | own), fields.get("von_mises")
        )

    def _record(self, part: str, values: dict[str, Any]) -> Record:
        """Append a record to a folder that is made now, when no mesh and no wrong scene can refuse any more."""
        results.make_folder(str(self.study.folder))
        return self.study.record(part, values)

    def _refuse(self, method: str, arguments: Sequence[str], message: str) -> None:
        curve = "isorod" if method == "cylindrical" else "finite elements"
        self._record("refused", {"curve": curve, "arguments": shlex.join(arguments), "message": message})


def scene_name(what: Subject) -> str:
    """Return the name of a scene for people."""
    return Path(what.word).stem


def _words(level: int, degree: int) -> list[str]:
    return ["--level", str(level), "--degree", str(degree)]
