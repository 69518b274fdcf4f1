"""The primary path of equilibria, from rest on, at load factors as they are asked for."""

from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.assembly.assembler import Assembler
from isorod.material.along_rod import Laws
from isorod.statics.newton import Newton
from isorod.statics.steps import Diverged

# How often a step is halved.
_HALVINGS = 8

# In so many steps the first equilibrium is reached.  A step in which the path goes so many times as fast as in the one
# before has left it, as past a limit point.
_STEPS, _FASTER = 5, 4.0

# No step begins this near (relative) to a critical load factor, where rounding leads off the path.
_APART = 5e-3


class Known(NamedTuple):
    """An equilibrium.

    Attributes
    ----------
    factor, x
        Its load factor and unknowns.
    speed, rate
        How fast these have changed on the way to it, the size of that infinite at rest.
    laws
        Those of this rank's parts, with the state there.
    """

    factor: float
    x: PETSc.Vec
    speed: float
    rate: PETSc.Vec
    laws: list[Laws]


class PathEnds(Exception):
    """No equilibrium is found beyond a load factor, ``reached``."""

    def __init__(self, reached: float, why: str) -> None:
        super().__init__(why)
        self.reached = reached


class Primary:
    """The equilibria that a model goes through as its loads and its supports' motions grow from nothing.

    Attributes
    ----------
    solver
        Newton's method on it.
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
        begin = max((one for one in self._known if self._starts(one, factor)), key=lambda one: one.factor)
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
            # What yields goes on faster.
            if why is None and newer > _FASTER * speed and not assembler.model.remembers:
                why = "the path goes on elsewhere"
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
        return next(one for one in self._known if one.factor == factor)

    def _starts(self, one: Known, factor: float) -> bool:
        """Return whether a step to a load factor may begin at an equilibrium."""
        return one.factor <= factor and all(abs(one.factor - here) > _APART * here for here in self.critical)

    def destroy(self) -> None:
        """Give back matrices and vectors."""
        self.solver.destroy()
        for one in self._known:
            one.x.destroy()
            one.rate.destroy()
