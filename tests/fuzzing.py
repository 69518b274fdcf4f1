"""What the tests with generated input share: the rule every input is held to, and makers of random models."""

import contextlib
import io
import json
import math
import os
import signal
import tempfile
import warnings
from pathlib import Path
from time import perf_counter
from unittest import mock

import numpy as np
import pytest

from isorod import Axis, LinearElastic, NeoHookean, Rod, Space, helix, model
from isorod.command import cli
from isorod.geometry import section
from isorod.material import muscle
from isorod.model import Body, BodyForce, Model, SectionLoad, Spin, Support
from isorod.output import progress

# Seconds that no input may take; most take hundredths of one.
LIMIT = 30.0

EDGES = [0.0, -0.0, -1.0, 1.0, 0.5, 5e-324, 1e-300, 1e-30, 1e30, 1e300, 1.7e308, math.nan, math.inf, -math.inf]
PETSC_TYPES = {
    "-ksp_type": ["gmres", "cg", "preonly", "minres", "bcgs"],
    "-pc_type": ["lu", "none", "jacobi", "ilu", "icc", "gamg", "cholesky"],
    "-snes_type": ["newtonls", "newtontr", "qn", "ngmres", "ksponly"],
    "-mat_type": ["aij", "baij", "dense"],
    "-snes_linesearch_type": ["bt", "basic", "l2", "cp"],
    "-eps_type": ["krylovschur", "lobpcg", "lapack", "power"],
    "-pc_factor_mat_solver_type": ["mumps", "petsc"],
}
TOLERANCES, SHIFTS, COUNTED = ["1e-3", "1e-6", "1e-9", "0"], ["0", "1", "-1", "1e3"], ["1", "5", "20", "50"]
PETSC_VALUES = {
    **PETSC_TYPES,
    **dict.fromkeys(["-snes_rtol", "-snes_atol", "-snes_stol", "-ksp_rtol", "-ksp_atol", "-eps_tol"], TOLERANCES),
    **dict.fromkeys(["-st_shift", "-eps_target"], SHIFTS),
    **dict.fromkeys(
        ["-snes_max_it", "-snes_max_funcs", "-ksp_max_it", "-eps_max_it", "-eps_nev", "-eps_ncv", "-eps_mpd"], COUNTED
    ),
}


class Hang(BaseException):
    """An input took too long."""


@contextlib.contextmanager
def limited():
    """Stop what takes longer than ``LIMIT``."""

    def stop(*_):
        raise Hang(f"more than {LIMIT:g} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LIMIT)
    start = perf_counter()
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert perf_counter() - start < LIMIT


def is_finite(value) -> bool:
    """Return whether all numbers in a record or an object's fields are finite."""
    if isinstance(value, dict):
        return all(is_finite(item) for item in value.values())
    if isinstance(value, list | tuple):
        return all(is_finite(item) for item in value)
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return bool(np.isfinite(value).all())
    return not isinstance(value, float) or math.isfinite(value)


@contextlib.contextmanager
def captured():
    """Yield what goes to standard output and error meanwhile, what C libraries write included."""
    texts = [io.StringIO(), io.StringIO()]
    kept = [os.dup(1), os.dup(2)]
    files = [tempfile.TemporaryFile(), tempfile.TemporaryFile()]
    try:
        for k, file in enumerate(files):
            os.dup2(file.fileno(), k + 1)
        with contextlib.redirect_stdout(texts[0]), contextlib.redirect_stderr(texts[1]):
            yield texts
    finally:
        for k, file in enumerate(files):
            os.dup2(kept[k], k + 1)
            os.close(kept[k])
            file.seek(0)
            texts[k].write(file.read().decode(errors="replace"))
            file.close()


def judge(words: list[str], folder: Path | None = None) -> None:
    """Run a command line in this process, in which PETSc runs already, and hold it to the rule."""
    from petsc4py import PETSc

    code = None
    # How far a run is, it says where it takes long, as all do on a busy machine.
    quiet = mock.patch.object(progress, "_FIRST", LIMIT)
    with warnings.catch_warnings(), captured() as (out, err), limited(), quiet:
        try:
            code = cli.main(words)
        except SystemExit as ended:
            # --help and --version.
            assert ended.code == 0
            return
        finally:
            for option in PETSc.Options().getAll():
                PETSc.Options().delValue(option)
    said = [line for line in err.getvalue().splitlines() if not line.startswith("isorod: warning: ")]
    written = [] if folder is None else sorted(file.name for file in folder.rglob("*"))
    if code == 2:
        assert out.getvalue() == ""
        assert len(said) == 1
        assert said[0].startswith("isorod: ")
        assert not written
        return
    assert (code, said) == (0, [])
    if "--json" in words:
        record = json.loads(out.getvalue().splitlines()[-1], parse_constant=pytest.fail)
        assert is_finite(record)
        if folder is not None:
            assert (folder / "new" / "results.jsonl").read_text() == out.getvalue()


class Maker:
    """Random values, ordinary ones in half of all cases, else one in twelve is odd."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.odd = self.rng.choice([0.0, 1.0 / 12.0])

    def seldom(self, often, *others):
        """Return the first value, or once in a while one of the others."""
        return others[self.rng.integers(len(others))] if self.rng.random() < self.odd else often

    def choice(self, *values):
        """Return one of the values."""
        return values[self.rng.integers(len(values))]

    def number(self, scale: float = 1.0) -> float:
        """Return a positive number of that size."""
        return self.seldom(scale * float(2.0 ** self.rng.uniform(-1.0, 1.0)), *EDGES)

    def vector(self, scale: float = 1.0) -> tuple[float, ...]:
        """Return a vector of components of both signs."""
        size = self.seldom(3, 3, 3, 0, 2, 4)
        return tuple(self.seldom(float(x), *EDGES) for x in scale * self.rng.uniform(-1.0, 1.0, size))

    def array(self, *shape: int) -> np.ndarray:
        """Return an array of numbers between -1 and 1."""
        shape = self.seldom(shape, shape, shape, (), (0,), (3,), (2, 3), (4, 4, 4, 4))
        values = self.rng.uniform(-1.0, 1.0, shape)
        if values.size:
            values.flat[0] = self.seldom(values.flat[0], *EDGES)
        return values

    def petsc(self, scene: str) -> list[str]:
        """Return PETSc options, of the scene's solver or not, with values that fit or do not."""
        own = ("-eps_", "-st_", "-mat_") if scene == "blade" else ("-snes_", "-ksp_", "-pc_", "-mat_")
        words = []
        for _ in range(self.rng.integers(1, 4)):
            known = [word for word in PETSC_VALUES if word.startswith(own)]
            word = self.choice(*known)
            words += [self.seldom(word, "-nosuch", "-snes_rtoll", *PETSC_VALUES), self.choice(*PETSC_VALUES[word])]
            words[-1] = self.seldom(
                words[-1], "nan", "-inf", "abc", "1e400", "-3", "99999999999", "2000000000", "0", "nosuch"
            )
        return words

    def axis(self) -> Axis:
        """Return an axis."""
        degree, breaks = int(self.rng.integers(1, 4)), np.cumsum(self.rng.uniform(0.3, 2.0, self.rng.integers(2, 4)))
        knots = np.array([*[breaks[0]] * degree, *breaks, *[breaks[-1]] * degree])
        weights = np.ones(knots.size - degree - 1)
        for values in (knots, weights):
            values[-1] = self.seldom(values[-1], 0.1, *EDGES)
        return Axis(self.seldom(degree, 0, 7, 10**9, 2.5, math.nan), knots, weights)

    def rod(self) -> Rod:
        """Return a helix, a rod of random control points, or a swept one."""
        kind, n = self.rng.integers(0, 6), self.seldom(int(self.rng.integers(3, 7)), 2, 10**9, 2.5)
        if kind == 0:
            turns, arcs = self.seldom(1, 0, 10**9), self.seldom(4, 3, 2, 10**9)
            line = helix(self.number(4.0), self.number(), turns, arcs)
            outline = section.circle(n, self.number())
            return line.sweep(outline)
        axis, closed = self.axis(), self.seldom(False, True)
        if kind == 1:
            return Rod(axis, self.array(axis.count, 4, 3), closed)
        heights = np.array([axis.knots[j + 1 : j + axis.degree + 1].mean() for j in range(axis.count)])
        centers = np.stack([0.0 * heights, 0.0 * heights, heights], axis=1)
        outline = section.circle(n, self.number()) if kind < 4 else section.ellipse(n, self.number(), self.number())
        stretches = self.array(axis.count, 3, 3)
        stretches = np.eye(3) + 0.1 * stretches if stretches.shape[-2:] == (3, 3) else stretches
        return Rod.sweep(outline, axis, centers, None, self.choice(None, stretches), closed)

    def space(self) -> Space:
        """Return a space on such a rod."""
        rod = self.rod()
        return Space.paper(
            rod,
            elements=self.seldom(rod.axis.elements * self.choice(1, 1, 2), 0, -1, 10**9),
            degree=self.seldom(max(rod.axis.degree, self.choice(1, 2, 3)), 0, 9, 10**9, 2.5, math.nan),
            continuity=self.seldom(None, 0, 1, -1, 10**9, math.inf),
            section_degree=self.seldom(self.choice(None, None, 2), 1, 3, 0, 10**9),
            order=self.seldom(1, 2, 7, 10**9, math.nan),
            section_points=self.seldom(None, 8, 0, 10**9),
            quadrature=self.choice("full", "auto", "3x2"),
        )

    def body(self) -> Body:
        """Return a body on such a space."""
        space, kind = self.space(), self.choice(NeoHookean, NeoHookean, LinearElastic, muscle.Muscle)
        own = [self.number() for _ in range(4)] if kind is muscle.Muscle else []
        material = kind(self.number(100.0), self.number(0.24), *own)
        return Body(space, material, self.number(), self.seldom(self.choice("displacement", "mixed"), "other"))

    def model(self) -> Model:
        """Return a model of one body with supports, loads, spin and contact."""
        body = self.body()
        end, letters = self.seldom("end", "side"), self.seldom("xyz", "z", "w", "", "xx")
        move = Support.end(body.space, end, letters, self.vector(0.1), turn=self.vector(0.1))
        supports = [Support.end(body.space, "start"), move][: self.seldom(self.choice(1, 2), 0)]
        if self.rng.random() < 0.1:
            nodes = self.rng.integers(-1, 15, self.rng.integers(4))
            supports.append(Support(nodes, "x", self.array(3), self.seldom(0, -1, 1)))
        loads = []
        if self.rng.random() < 0.3:
            loads.append(self.choice(BodyForce(self.vector()), SectionLoad.end(body.space, "end", self.vector())))
        spin = Spin(self.vector(), self.vector()) if self.rng.random() < 0.1 else None
        contacts = []
        if self.rng.random() < 0.2:
            place = model.Plane(self.vector(), self.vector())
            obstacle = self.choice(place, model.Cylinder(place.point, place.normal, self.number()))
            deepest = self.seldom(None, 0.1, *EDGES)
            contacts.append(model.Contact(self.seldom(0, 1, -1), obstacle, self.number(), penetration=deepest))
        return Model([body], supports, spin, contacts, loads)
