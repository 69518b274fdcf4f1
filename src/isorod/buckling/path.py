"""The primary path of equilibria, which begins at rest, at given load factors."""

from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.assembly.assembler import Assembler
from isorod.material.along_rod import Laws
from isorod.statics.newton import Newton
from isorod.statics.steps import Diverged

# Maximum number of halvings of a step.
_HALVINGS = 8

# Number of steps to the first equilibrium.  A step in which the displacements change this many times as fast as in the
# one before has left the path, as past a limit point.
_STEPS, _FASTER = 5, 4.0

# No step begins at this (relative) distance from a critical load factor or less, where rounding may leave the path.
_APART = 5e-3


class Known(NamedTuple):
    """An equilibrium.

    Attributes
    ----------
    factor, x
        Its load factor and unknowns.
    speed, rate
        The derivative of these with the load factor in the last step: its norm, infinite at rest, and itself.
    laws
        Those of this rank's parts, with the state there.
    """

    factor: float
    x: PETSc.Vec
    speed: float
    rate: PETSc.Vec
    laws: list[Laws]


class PathEnds(Exception):
    """There is no equilibrium beyond the load factor ``reached``."""

    def __init__(self, reached: float, why: str) -> None:
        super().__init__(why)
        self.reached = reached


class Primary:
    """The equilibria of a model as its loads and its supports' motions grow from zero.

    Attributes
    ----------
    solver
        Newton's method.
    critical
        Load factors at which the tangent is known to be singular.
    """

    def __init__(self, assembler: Assembler) -> None:
        self.solver = Newton(assembler, [])
        self.critical: list[float] = []
        self._known = [Known(0.0, assembler.vector(), np.inf, assembler.vector(), assembler.laws)]

    def at(self, factor: float) -> Known:
        """Return the equilibrium at a load factor; raises `PathEnds` where there is none."""
        solver, assembler = self.solver, self.solver.assembler
        begin = max((known for known in self._known if self._starts(known, factor)), key=lambda known: known.factor)
        begin.x.copy(solver.x)
        assembler.obey(begin.laws)
        solver.forget_path()
        reached, step, speed = begin.factor, factor - begin.factor, begin.speed
        # The speed of supports that turn is the same beyond load factor 1.
        longest = min(solver.steps.turning.longest_step(0.0), factor / _STEPS)
        shortest = min(step, longest) / 2**_HALVINGS
        while reached < factor:
            target = reached + min(step, longest)
            target = factor if target > factor * (1.0 - 1e-12) else target
            before = solver.x.copy()
            why = None
            try:
                solver.advance(reached, target)
            except Diverged as problem:
                why = str(problem)
            newer = (solver.x - before).norm() / (target - reached)
            # A law that yields is faster.
            if why is None and newer > _FASTER * speed and not assembler.model.remembers:
                why = "the path continues elsewhere"
            if why is not None:
                before.copy(solver.x)
                solver.forget_path()
                step = 0.5 * (target - reached)
                if step < shortest:
                    raise PathEnds(reached, why)
                continue
            rate = (solver.x - before) / (target - reached)
            reached, speed, step = target, newer, 2.0 * step
            assembler.advance(solver.x, reached)
            self._known.append(Known(reached, solver.x.copy(), speed, rate, assembler.laws))
        return next(known for known in self._known if known.factor == factor)

    def _starts(self, known: Known, factor: float) -> bool:
        """Return whether a step to a load factor may begin at an equilibrium."""
        return known.factor <= factor and all(abs(known.factor - here) > _APART * here for here in self.critical)

    def destroy(self) -> None:
        """Give back matrices and vectors."""
        self.solver.destroy()
        for known in self._known:
            known.x.destroy()
            known.rate.destroy()
