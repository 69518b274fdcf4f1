"""The source of the compiled functions of a law, generated from its two potentials.

In a step of time ``t`` the internal variables ``a`` minimise ``W(E, a) + t phi((a - a_n)/t)``, by Newton's method with
a Cholesky factor and a line search that halves steps until they descend.  At the minimum stress and moduli are

    T = W_E,    dT/dE = W_EE - W_Ea K^-1 W_aE,

``K`` the second derivative of the sum by ``a``: symmetric (M. Ortiz & L. Stainier, CMAME 171 (1999) 419-444).
"""

from collections.abc import Sequence

import sympy as sp

from isorod.material.printed import assignments
from isorod.material.symbols import ENTRIES, strain

STEP = sp.Symbol("step", positive=True)

_HEAD = '''"""Written from the potentials of a law."""

import numpy as np
from math import erf
from isorod.compiled import FAST, njit
from isorod.material.dissipative_kernel import condensed, factor, read_state, solved, squared, write_state
from isorod.material.functions import exp, expm1, log, power
from isorod.material.logarithm_kernel import STRAIN, TENSION, add_moduli, put_stress, strains
from isorod.material.points import ACTIVE, BLOCK, ENERGY, POINTS, ROWS, TANGENT
from isorod.material.six_kernel import at

COUNT = {count}
PLACES = np.array({places})
'''

_TAIL = '''
@njit(**FAST)
def _settle(e, old, constants, a, room, slopes, bends):
    """Fill in the internal variables at the end of the step, and the factor of the second derivative there."""
    tried, direction = room[0], room[1]
    a[:] = old
    if not constants[0] > 0.0:
        return True
    value = _sum(e, a, old, constants)
    for _ in range(60):
        _bends(e, a, old, constants, slopes, bends)
        if not factor(bends):
            return False
        solved(bends, slopes, direction)
        descent = 0.0
        for i in range(COUNT):
            descent += slopes[i] * direction[i]
        if not descent >= 0.0:
            return False
        length = 1.0
        for _ in range(40):
            for i in range(COUNT):
                tried[i] = a[i] - length * direction[i]
            new = _sum(e, tried, old, constants)
            # Differences by rounding count as descent.
            if new <= value - 1e-4 * length * descent + 1e-13 * abs(value):
                break
            length *= 0.5
        value = new
        a[:] = tried
        if length == 1.0 and squared(direction) <= 1e-26 * squared(a) + 1e-40:
            return value == value
    return False


@njit(BLOCK, **FAST)
def block(work, constants, activation, with_energy):
    """Fill in the stress, and with ``with_energy`` the energy."""
    _go(work, constants, with_energy, False)


@njit(BLOCK, **FAST)
def update(work, constants, activation, with_energy):
    """Fill in the stress, and replace the state by that at the end of the step."""
    _go(work, constants, False, True)


@njit(**FAST)
def _go(work, constants, with_energy, goes_on):
    """Fill in the stress, and with ``with_energy`` the energy; or advance the state."""
    e, stress = np.empty(6), np.empty(6)
    a, old = np.empty(COUNT), np.empty(COUNT)
    room, slopes, bends = np.empty((2, COUNT)), np.empty(COUNT), np.empty((COUNT, COUNT))
    strains(work)
    for k in range(np.uint64(POINTS)):
        for m in range(6):
            e[m] = work[at(STRAIN + m) + k]
        read_state(work, k, PLACES, old)
        settled = _settle(e, old, constants, a, room, slopes, bends)
        _stress(e, a, constants, stress)
        for m in range(6):
            work[at(TENSION + m) + k] = stress[m] if settled else np.nan
        if with_energy:
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = _stored(e, a, constants), 0.0
        if goes_on:
            write_state(work, k, PLACES, TRACES, a)
    put_stress(work)


@njit(TANGENT, **FAST)
def tangent(work, constants, activation):
    """Add the moduli."""
    moduli, e, stress = np.empty(36 * POINTS), np.empty(6), np.empty(6)
    a, old = np.empty(COUNT), np.empty(COUNT)
    room, slopes, bends = np.empty((2, COUNT)), np.empty(COUNT), np.empty((COUNT, COUNT))
    stiff, crossed = np.empty((6, 6)), np.empty((6, COUNT))
    rule = strains(work)
    for k in range(np.uint64(POINTS)):
        for m in range(6):
            e[m] = work[at(STRAIN + m) + k]
        read_state(work, k, PLACES, old)
        settled = _settle(e, old, constants, a, room, slopes, bends)
        _stress(e, a, constants, stress)
        _moduli(e, a, constants, stiff, crossed)
        if constants[0] > 0.0:
            _bends(e, a, old, constants, slopes, bends)
            settled = factor(bends) and settled
            condensed(stiff, crossed, bends)
        for m in range(6):
            work[at(TENSION + m) + k] = stress[m] if settled else np.nan
        for m in range(6):
            for n in range(6):
                moduli[at(6 * m + n) + k] = stiff[m, n]
    add_moduli(work, rule, moduli)
'''


def source(
    energy: sp.Expr,
    dissipation: sp.Expr,
    pairs: Sequence[tuple[sp.Symbol, sp.Symbol]],
    places: Sequence[int],
    traces: Sequence[tuple[int, int, int]],
    constants: Sequence[sp.Symbol],
) -> str:
    """Return the source of a module with the functions `block`, `tangent` and `update` of a law.

    Parameters
    ----------
    energy, dissipation
        Expressions of `isorod.material.symbols.strain`, variables and constants; of rates and constants.
    pairs, places
        Each variable with its rate, and its place in the state.
    traces
        Places in the state of a component that is minus the sum of two others, and of these.
    constants
        Their symbols, in the order of the law's constants after the time of the step.
    """
    names = {one: sp.Symbol(f"constant{k}", real=True) for k, one in enumerate(constants)}
    variables = [sp.Symbol(f"a{k}", real=True) for k in range(len(pairs))]
    old = [sp.Symbol(f"old{k}", real=True) for k in range(len(pairs))]
    e = list(ENTRIES)
    energy = energy.xreplace(names | dict(zip([one for one, _ in pairs], variables, strict=True)))
    rates = {rate: (a - b) / STEP for (_, rate), a, b in zip(pairs, variables, old, strict=True)}
    total = energy + STEP * dissipation.xreplace(names).subs(rates)
    twice = [1 if i == j else 2 for i in range(3) for j in range(i, 3)]
    slopes = [sp.diff(total, one) for one in variables]
    stress = [sp.diff(energy, one) / count for one, count in zip(e, twice, strict=True)]
    every = {"e": e, "a": variables, "old": old, "constants": [STEP, *names.values()]}
    text = [_HEAD.format(count=len(variables), places=list(places))]
    text.append(f"TRACES = np.array({[list(one) for one in traces] or [[-1, 0, 0]]})\n")
    text += _function("_sum", every, "e a old constants", {"return": total})
    text += _function("_stored", every, "e a constants", {"return": energy})
    text += _function("_stress", every, "e a constants", {f"stress[{k}]": one for k, one in enumerate(stress)})
    bends = {f"slopes[{k}]": one for k, one in enumerate(slopes)}
    bends |= {f"bends[{i}, {j}]": sp.diff(slopes[i], variables[j]) for i in range(len(variables)) for j in range(i + 1)}
    text += _function("_bends", every, "e a old constants", bends)
    moduli = {f"stiff[{i}, {j}]": sp.diff(stress[i], e[j]) / twice[j] for i in range(6) for j in range(6)}
    moduli |= {f"crossed[{i}, {k}]": sp.diff(stress[i], variables[k]) for i in range(6) for k in range(len(variables))}
    text += _function("_moduli", every, "e a constants", moduli)
    return "\n".join(text) + _TAIL


def _function(name: str, every: dict[str, list[sp.Symbol]], given: str, targets: dict[str, sp.Expr]) -> list[str]:
    """Return the lines of a function that fills in the given targets, or returns one."""
    arrays = list(dict.fromkeys(one.split("[")[0] for one in targets if "[" in one))
    free = set().union(*[one.free_symbols for one in targets.values()])
    lines = ["", "@njit(**FAST)", f"def {name}({', '.join([*given.split(), *arrays])}):"]
    for which in given.split():
        lines += [f"    {one} = {which}[{k}]" for k, one in enumerate(every[which]) if one in free]
    results = [f"result{k}" for k in range(len(targets))]
    lines += [f"    {line}" for line in assignments(results, list(targets.values()))]
    lines += [
        f"    return {one}" if target == "return" else f"    {target} = {one}"
        for target, one in zip(targets, results, strict=True)
    ]
    return [*lines, ""]


def free_of(expression: sp.Expr, known: Sequence[sp.Symbol]) -> list[str]:
    """Return the names of unknown symbols of an expression."""
    return sorted(str(one) for one in expression.free_symbols - {*known} - {*strain})
