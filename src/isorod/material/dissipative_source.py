"""The source of the compiled functions of a law of two potentials, written from these.

In a step of time ``t`` the internal variables ``a`` minimise ``W(E, a) + t phi((a - a_n)/t)``, by Newton's method with
Cholesky's factor and steps that are halved while they do not descend.  Where it ends stress and moduli are

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
from isorod.material.dissipative_kernel import condensed, factor, solved, squared, told, written
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
    tried, way = room[0], room[1]
    a[:] = old
    if not constants[0] > 0.0:
        return True
    value = _sum(e, a, old, constants)
    for _ in range(60):
        _bends(e, a, old, constants, slopes, bends)
        if not factor(bends):
            return False
        solved(bends, slopes, way)
        descent = 0.0
        for i in range(COUNT):
            descent += slopes[i] * way[i]
        if not descent >= 0.0:
            return False
        share = 1.0
        for _ in range(40):
            for i in range(COUNT):
                tried[i] = a[i] - share * way[i]
            new = _sum(e, tried, old, constants)
            # What differs by rounding alone descends.
            if new <= value - 1e-4 * share * descent + 1e-13 * abs(value):
                break
            share *= 0.5
        value = new
        a[:] = tried
        if share == 1.0 and squared(way) <= 1e-26 * squared(a) + 1e-40:
            return value == value
    return False


@njit(BLOCK, **FAST)
def block(work, constants, activation, wanted):
    """Fill in the stress, and if wanted the energy."""
    _go(work, constants, wanted, False)


@njit(BLOCK, **FAST)
def update(work, constants, activation, wanted):
    """Fill in the stress, and replace the state by that at the end of the step."""
    _go(work, constants, False, True)


@njit(**FAST)
def _go(work, constants, wanted, goes_on):
    """Fill in the stress, and if wanted the energy; or let the state go on."""
    e, stress = np.empty(6), np.empty(6)
    a, old = np.empty(COUNT), np.empty(COUNT)
    room, slopes, bends = np.empty((2, COUNT)), np.empty(COUNT), np.empty((COUNT, COUNT))
    strains(work)
    for k in range(np.uint64(POINTS)):
        for m in range(6):
            e[m] = work[at(STRAIN + m) + k]
        told(work, k, PLACES, old)
        settled = _settle(e, old, constants, a, room, slopes, bends)
        _stress(e, a, constants, stress)
        for m in range(6):
            work[at(TENSION + m) + k] = stress[m] if settled else np.nan
        if wanted:
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = _stored(e, a, constants), 0.0
        if goes_on:
            written(work, k, PLACES, TRACES, a)
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
        told(work, k, PLACES, old)
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
        Of `isorod.material.symbols.strain`, variables and constants; of rates and constants.
    pairs, places
        Each variable with its rate, and where it is in the state.
    traces
        Where in the state a component is less the sum of two others.
    constants
        Their symbols, in the order of the law's behind the time of the step.
    """
    names = {one: sp.Symbol(f"constant{k}", real=True) for k, one in enumerate(constants)}
    own = [sp.Symbol(f"a{k}", real=True) for k in range(len(pairs))]
    old = [sp.Symbol(f"old{k}", real=True) for k in range(len(pairs))]
    e = list(ENTRIES)
    energy = energy.xreplace(names | dict(zip([one for one, _ in pairs], own, strict=True)))
    rates = {rate: (a - b) / STEP for (_, rate), a, b in zip(pairs, own, old, strict=True)}
    total = energy + STEP * dissipation.xreplace(names).subs(rates)
    twice = [1 if i == j else 2 for i in range(3) for j in range(i, 3)]
    slopes = [sp.diff(total, one) for one in own]
    stress = [sp.diff(energy, one) / count for one, count in zip(e, twice, strict=True)]
    every = {"e": e, "a": own, "old": old, "constants": [STEP, *names.values()]}
    text = [_HEAD.format(count=len(own), places=list(places))]
    text.append(f"TRACES = np.array({[list(one) for one in traces] or [[-1, 0, 0]]})\n")
    text += _function("_sum", every, "e a old constants", {"return": total})
    text += _function("_stored", every, "e a constants", {"return": energy})
    text += _function("_stress", every, "e a constants", {f"stress[{k}]": one for k, one in enumerate(stress)})
    bends = {f"slopes[{k}]": one for k, one in enumerate(slopes)}
    bends |= {f"bends[{i}, {j}]": sp.diff(slopes[i], own[j]) for i in range(len(own)) for j in range(i + 1)}
    text += _function("_bends", every, "e a old constants", bends)
    moduli = {f"stiff[{i}, {j}]": sp.diff(stress[i], e[j]) / twice[j] for i in range(6) for j in range(6)}
    moduli |= {f"crossed[{i}, {k}]": sp.diff(stress[i], own[k]) for i in range(6) for k in range(len(own))}
    text += _function("_moduli", every, "e a constants", moduli)
    return "\n".join(text) + _TAIL


def _function(name: str, every: dict[str, list[sp.Symbol]], given: str, wanted: dict[str, sp.Expr]) -> list[str]:
    """Return the lines of a function that fills in what is wanted, or returns it."""
    found = list(dict.fromkeys(one.split("[")[0] for one in wanted if "[" in one))
    free = set().union(*[one.free_symbols for one in wanted.values()])
    lines = ["", "@njit(**FAST)", f"def {name}({', '.join([*given.split(), *found])}):"]
    for which in given.split():
        lines += [f"    {one} = {which}[{k}]" for k, one in enumerate(every[which]) if one in free]
    results = [f"result{k}" for k in range(len(wanted))]
    lines += [f"    {line}" for line in assignments(results, list(wanted.values()))]
    lines += [
        f"    return {one}" if target == "return" else f"    {target} = {one}"
        for target, one in zip(wanted, results, strict=True)
    ]
    return [*lines, ""]


def free_of(expression: sp.Expr, known: Sequence[sp.Symbol]) -> list[str]:
    """Return the names of the symbols of an expression that are not known."""
    return sorted(str(one) for one in expression.free_symbols - {*known} - {*strain})
