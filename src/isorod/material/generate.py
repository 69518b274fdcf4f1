"""The source of a law's compiled functions, written from its energy.

With the scalars ``s`` that an energy depends on and ``D_s = ds/dF``,

    P = sum_s W_s D_s,    dP/dF = sum_st W_st D_s D_t + sum_s W_s dD_s/dF,

where SymPy derives ``W_s`` and ``W_st``; the rest is the same for all laws.  With the components of ``C``

    P = F S,    dP_aA/dF_bB = d_ab S_AB + F_aC F_bD dS_CA/dE_DB,

the second Piola-Kirchhoff stress ``S = 2 dW/dC`` and ``E = (C - 1)/2``; in small strains ``P = S`` and ``dS/dE`` alone.
Functions that loops can vectorise are in `isorod.material.functions`.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from itertools import combinations, combinations_with_replacement

import sympy as sp

from isorod.material import symbols as s
from isorod.material.energy import Energy
from isorod.material.points import ACTIVE, DETERMINANT, ENERGY, FIBRE, GRADIENT, MODULI, ROWS, SQUARES
from isorod.material.printed import assignments

# Names that generated modules may import; only those used are, since imports take time in each process.
_NAMES = {
    "math": "erf",
    "isorod.compiled": "FAST njit",
    "isorod.material.functions": "SPECTRAL exp expm1 log of_small power principals",
    "isorod.material.moduli_kernel": "add_both add_diagonal add_dyad add_rows add_turned combined outer scaled",
    "isorod.material.points": "BLOCK POINTS TANGENT add_identity add_products add_square",
}

_COMPONENTS = [(a, A) for a in range(3) for A in range(3)]


def source(energy: Energy) -> str:
    """Return the source of a module with the functions `block` and `tangent` of a law.

    Raises
    ------
    InputError
        If the energy has a function that is not known here.
    """
    body = _Body(energy)
    functions = [*body.block(), "", "", *body.tangent(), ""]
    used = {word for line in functions for word in re.findall(r"\w+", line)}
    lines = ['"""Written from the energy of a law."""', "", "import numpy as np"]
    for module, names in _NAMES.items():
        if own := [name for name in names.split() if name in used]:
            lines.append(f"from {module} import {', '.join(own)}")
    rows = sorted(int(word[3:]) for word in used if re.fullmatch(r"ROW\d+", word))
    lines += ["", *(f"ROW{row} = np.uint64({ROWS[row]})" for row in rows), "", ""]
    return "\n".join([*lines, *functions])


def _row(number: int) -> str:
    """Return the name of the offset of a row of a block: a constant compiles faster than a sum."""
    return f"ROW{number}"


def _needed(lines: Sequence[str], names: Iterable[str]) -> list[str]:
    """Return the assignments that names depend on; each name is assigned once."""
    needed, kept = set(names), []
    for line in reversed(lines):
        name, value = line.split(" = ", 1)
        if name in needed:
            kept.append(line)
            needed.update(re.findall(r"[A-Za-z_]\w*", value))
    return kept[::-1]


def _slope(expression: sp.Expr, by: sp.Symbol) -> sp.Expr:
    """Return a derivative, that of jumps left out."""
    return sp.diff(expression, by).replace(sp.DiracDelta, lambda *_: sp.Integer(0))


# Components of F^T F.
_SQUARES = {(A, B): " + ".join(f"f{a}{A} * f{a}{B}" for a in range(3)) for A in range(3) for B in range(A, 3)}

# Scalars whose derivative by F is computed without a factor of 2.
_TWICE = (s.I1, s.I2, s.I4a, s.I4b)


def _modulus(a: int, A: int, b: int, B: int) -> str:
    """Return the name of the offset of the row of ``dP_aA/dF_bB``, ``a <= b``, and ``A <= B`` if these are equal."""
    return _row(SQUARES + 6 * a + (B if A == 0 else A + B + 1) if a == b else MODULI + 9 * (a + b - 1) + 3 * A + B)


def _products(pairs: Iterable[tuple[str, str]]) -> str:
    """Return a sum of products, without those with an empty factor."""
    given = [(x, y) for x, y in pairs if x and y]
    return " + ".join(y if x == "1.0" else f"{x} * {y}" for x, y in given)


def _nine(name: str) -> str:
    """Return a tuple of components."""
    return f"({', '.join(f'{name}{a}{A}' for a, A in _COMPONENTS)})"


def _sum(terms: Sequence[tuple[str, sp.Symbol]]) -> str:
    """Return the sum of the derivatives of scalars by F, each with its factor."""
    factors = [(f"2.0 * {w}" if one in _TWICE else w, f"d_{one}") for w, one in terms]
    if not factors:
        return "(" + "0.0, " * 9 + ")"
    text = "scaled({}, {})".format(*factors[0])
    if len(factors) > 1:
        (w, d), (x, e) = factors[:2]
        text = f"combined({w}, {d}, {x}, {e})"
    for w, d in factors[2:]:
        text = f"combined(1.0, {text}, {w}, {d})"
    return text


class _Body:
    """The bodies of the loops over points."""

    def __init__(self, energy: Energy) -> None:
        self.energy = energy
        # Unique names.
        self.names = {one: sp.Symbol(f"constant{k}", real=True) for k, one in enumerate(energy.constants)}
        expression = energy.total.xreplace(self.names)
        self.plain = bool(set(s.F) & expression.free_symbols)
        self.strains = bool(set(s.STRAINS) & expression.free_symbols)
        candidates = s.F if self.plain else s.STRAINS if self.strains else s.INVARIANTS
        self.scalars = [one for one in candidates if self.plain or one in expression.free_symbols]
        if set(s.stretches) & set(self.scalars):
            self.scalars = [one for one in self.scalars if one not in s.stretches] + list(s.stretches)
        self.first = {one: _slope(expression, one) for one in self.scalars}
        self.second = {(p, q): _slope(self.first[p], q) for k, p in enumerate(self.scalars) for q in self.scalars[k:]}
        if self.strains:
            # S and dS/dE: symbols beside the diagonal of C stand for two components.
            twice = {one: 2 if one in s.C.diagonal() else 1 for one in s.STRAINS}
            self.first = {one: twice[one] * value for one, value in self.first.items()}
            self.second = {(p, q): twice[p] * twice[q] * value for (p, q), value in self.second.items()}
        self.used = expression.free_symbols
        self.rest = expression.subs(s.activation, 0)
        self.active = sp.diff(expression, s.activation)

    # Lines before the loop, and those that read a point.

    def _constants(self) -> list[str]:
        return [f"    {one} = constants[{k}]" for k, one in enumerate(self.names.values()) if one in self.used]

    def _fibres(self, read: Callable[[int], str]) -> list[str]:
        names = "a0 a1 a2 b0 b1 b2".split()[: 3 * self.energy.families] + ["temperature"] * (s.temperature in self.used)
        return [f"{name} = {read(k)}" for k, name in enumerate(names)]

    def _kinematics(self) -> list[str]:
        """Return lines that compute the arguments of the energy from ``f00 .. f22`` and the fibres."""
        if self.plain:
            return [f"F{a}{A} = f{a}{A}" for a, A in _COMPONENTS]
        if self.strains:
            small = {(A, B): f"f{A}{B} + f{B}{A}" + (" - 1.0" if A == B else "") for A, B in _SQUARES}
            return [f"C{A}{B} = {value}" for (A, B), value in (small if self.energy.small else _SQUARES).items()]
        has = set(self.scalars)
        lines = []
        if s.J in has:
            lines += ["J = det"]
            for a, A in _COMPONENTS:
                a1, a2, A1, A2 = (a + 1) % 3, (a + 2) % 3, (A + 1) % 3, (A + 2) % 3
                lines.append(f"g{a}{A} = f{a1}{A1} * f{a2}{A2} - f{a1}{A2} * f{a2}{A1}")
        lines += [f"c{A}{B} = {value}" for (A, B), value in _SQUARES.items() if s.I2 in has]
        if has & {s.I1, s.I2}:
            lines.append("I1 = " + " + ".join(f"f{a}{A} * f{a}{A}" for a, A in _COMPONENTS))
        if s.I2 in has:
            lines.append("I2 = c00 * c11 + c00 * c22 + c11 * c22 - c01 * c01 - c02 * c02 - c12 * c12")
            for a, A in _COMPONENTS:
                product = " + ".join(f"f{a}{B} * c{min(A, B)}{max(A, B)}" for B in range(3))
                lines.append(f"h{a}{A} = I1 * f{a}{A} - ({product})")
        for fibre, name in ((s.I4a, "a"), (s.I4b, "b")):
            if fibre in has or s.I8 in has:
                for k in range(3):
                    lines.append(f"{name}n{k} = " + " + ".join(f"f{k}{A} * {name}{A}" for A in range(3)))
                lines += [f"{name} = ({name}0, {name}1, {name}2)", f"{name}n = ({name}n0, {name}n1, {name}n2)"]
                if fibre in has:
                    # Points that only fill up a block have no fibre.
                    lines.append(f"{fibre} = " + " + ".join(f"{name}n{k} * {name}n{k}" for k in range(3)))
                    lines.append(f"{fibre} = {fibre} if {fibre} > 0.0 else 1.0")
        if s.I8 in has:
            lines.append("I8 = " + " + ".join(f"an{k} * bn{k}" for k in range(3)))
        if s.stretches[0] in has:
            for i, row in enumerate((0, 3, 5)):
                lines.append(f"l{i + 1} = np.sqrt(spectral[{_row(row)} + k])")
                lines += [f"v{i}{A} = spectral[{_row(6 + 3 * i + A)} + k]" for A in range(3)]
                for a in range(3):
                    product = " + ".join(f"f{a}{A} * v{i}{A}" for A in range(3))
                    lines.append(f"n{i}{a} = ({product}) / l{i + 1}")
                lines += [f"v{i} = (v{i}0, v{i}1, v{i}2)", f"n{i} = (n{i}0, n{i}1, n{i}2)"]
        return lines

    def _spectral(self) -> list[str]:
        """Return lines that fill in ``F^T F`` for `principals`; none if the energy has no principal stretches."""
        if s.stretches[0] not in self.scalars:
            return []
        return [f"spectral[{_row(row)} + k] = {value}" for row, value in enumerate(_SQUARES.values())]

    def _slopes(self, second: bool = False) -> list[str]:
        """Return lines that compute the derivatives of the energy, NaN where an element is inverted."""
        names, values = [f"w_{one}" for one in self.scalars], list(self.first.values())
        if second:
            nonzero = {pair: value for pair, value in self.second.items() if value != 0}
            names += [f"w_{p}_{q}" for p, q in nonzero]
            values += list(nonzero.values())
        lines = assignments(names, values)
        if self.energy.small:
            return lines
        lines.append("valid = 1.0 if det > 0.0 else np.nan")
        return lines + [f"w_{one} = valid * w_{one}" for one in self.scalars]

    def _stress(self) -> list[str]:
        """Return lines that compute ``p``, the nine components of the stress."""
        if self.plain:
            return [f"p = ({', '.join(f'w_F{a}{A}' for a, A in _COMPONENTS)})"]
        if self.strains:
            slopes = {(A, B): self._slope_by_strain(A, B) for A, B in _COMPONENTS}
            components = [_products((self._f(a, B), slopes[A, B]) for B in range(3)) or "0.0" for a, A in _COMPONENTS]
            return [f"p = ({', '.join(components)})"]
        return [*self._directions(), f"p = {_sum([(f'w_{one}', one) for one in self.scalars])}"]

    def _directions(self) -> list[str]:
        """Return lines that compute the ``D_s``, but for a factor of 2 of some (`_TWICE`)."""
        terms = {s.I1: _nine("f"), s.I2: _nine("h"), s.J: _nine("g"), s.I4a: "outer(an, a)", s.I4b: "outer(bn, b)"}
        terms[s.I8] = "combined(1.0, outer(an, b), 1.0, outer(bn, a))"
        terms |= {one: f"outer(n{i}, v{i})" for i, one in enumerate(s.stretches)}
        return [f"d_{one} = {terms[one]}" for one in self.scalars]

    def _head(self, name: str, arguments: str) -> list[str]:
        lines = [f"@njit({name.upper()}, **FAST)", f"def {name}({arguments}):", *self._constants()]
        if spectral := self._spectral():
            lines += ["    spectral = np.empty(SPECTRAL * POINTS)", *self._loop([*self._read(), *spectral])]
            lines += ["    principals(spectral, POINTS)"]
        return lines

    def _read(self) -> list[str]:
        lines = [f"f{a}{A} = work[{_row(GRADIENT + 3 * a + A)} + k]" for a, A in _COMPONENTS]
        lines.append(f"det = work[{_row(DETERMINANT)} + k]")
        return lines + self._fibres(lambda k: f"work[{_row(FIBRE + k)} + k]")

    @staticmethod
    def _loop(body: Iterable[str], deep: int = 1) -> list[str]:
        space = "    " * deep
        return [f"{space}for k in range(np.uint64(POINTS)):", *[f"{space}    {one}" for one in body]]

    def block(self) -> list[str]:
        """Return the function of a block of points."""
        body = [*self._read(), *self._kinematics(), *self._slopes(), *self._stress()]
        body += [f"work[{_row(component)} + k] = p[{component}]" for component in range(9)]
        lines = self._head("block", "work, constants, activation, with_energy")
        lines += [*self._loop(body), "    if with_energy:"]
        # With the slopes without activation, from which the energy of small strains is computed.
        slopes = {f"w_{one}": w.subs(s.activation, 0) for one, w in self.first.items()} if self.energy.rests else {}
        values = {"rest": self.rest, "active": self.active} | slopes
        energies = [*self._read(), *self._kinematics(), *assignments(list(values), list(values.values()))]
        energies += [*self._stress(), f"rest = of_small({_nine('f')}, p, rest)"] if slopes else []
        # Laws of small strains are linear and also evaluated for modes of any amplitude, where det F may be negative.
        if not self.energy.small:
            energies += ["valid = 1.0 if det > 0.0 else np.nan", "rest = valid * rest", "active = valid * active"]
        outputs = [f"work[{_row(row)} + k] = {name}" for row, name in ((ENERGY, "rest"), (ACTIVE, "active"))]
        return lines + self._loop(_needed(energies, ("rest", "active")) + outputs, 2)

    def tangent(self) -> list[str]:
        """Return the function that adds the moduli."""
        body = [*self._read(), *self._kinematics(), *self._slopes(second=True)]
        body += self._plain_moduli() if self.plain else self._strain_moduli() if self.strains else self._moduli()
        return [*self._head("tangent", "work, constants, activation"), *self._loop(body)]

    def _w(self, p: sp.Symbol, q: sp.Symbol) -> str:
        """Return the name of a second derivative, empty where it is zero."""
        pair = (p, q) if (p, q) in self.second else (q, p)
        return "" if self.second.get(pair, 0) == 0 else f"w_{pair[0]}_{pair[1]}"

    def _plain_moduli(self) -> list[str]:
        """Return lines that add the second derivatives by components of ``F``."""
        lines = []
        for (p, q), value in self.second.items():
            if value == 0:
                continue
            row = _modulus(*(int(x) for x in str(p)[1:] + str(q)[1:]))
            lines.append(f"work[{row} + k] += valid * w_{p}_{q}")
        return lines

    def _f(self, a: int, A: int) -> str:
        """Return the factor ``F_aA`` of second stresses and their slopes, empty where it is zero."""
        if self.energy.small:
            return "1.0" if a == A else ""
        return f"f{a}{A}"

    def _slope_by_strain(self, A: int, B: int) -> str:
        """Return the name of ``S_AB``, empty where it is zero."""
        return "" if self.first.get(s.C[A, B], 0) == 0 else f"w_{s.C[A, B]}"

    def _strain_moduli(self) -> list[str]:
        """Return lines that add ``d_ab S_AB + F_aC F_bD dS_CA/dE_DB``."""
        lines, turned = [], {}
        for a, A in _COMPONENTS:
            for scalar in self.scalars:
                text = _products((self._f(a, C), self._w(s.C[C, A], scalar)) for C in range(3))
                if text and not self.energy.small:
                    lines.append(f"t{a}{A}_{scalar} = {text}")
                    text = f"t{a}{A}_{scalar}"
                turned[a, A, scalar] = text
        for (a, A), (b, B) in combinations_with_replacement(_COMPONENTS, 2):
            if a == b and A > B:
                continue
            text = _products((self._f(b, D), turned.get((a, A, s.C[D, B]), "")) for D in range(3))
            if a == b and not self.energy.small:
                text = " + ".join(term for term in (text, self._slope_by_strain(A, B)) if term)
            if text:
                lines.append(f"work[{_modulus(a, A, b, B)} + k] += {text}")
        return lines

    def _moduli(self) -> list[str]:
        """Return lines that add the terms of all scalars."""
        has, lines = set(self.scalars), ["same = 0.0"]
        rows = {name: tuple(f"({name}{a}0, {name}{a}1, {name}{a}2)" for a in range(3)) for name in "fgh"}
        if s.I1 in has:
            lines.append("same += 2.0 * w_I1")
        if s.I2 in has:
            lines.append("same += 2.0 * w_I2 * I1")
        bend_I1 = f"{(s.I1 in has and self._w(s.I1, s.I1)) or '0.0'}"
        if s.I2 in has or bend_I1 != "0.0":
            x = "4.0 * w_I2" if s.I2 in has else "0.0"
            y = "-2.0 * w_I2" if s.I2 in has else "0.0"
            lines.append(f"add_products(work, k, {x} + 4.0 * {bend_I1}, {y}, {', '.join(rows['f'])})")
        if s.J in has:
            bend_J = self._w(s.J, s.J) or "0.0"
            lines.append("bent = w_J / J")
            lines.append(f"add_products(work, k, {bend_J} + bent, -bent, {', '.join(rows['g'])})")
        if s.I2 in has:
            lines += [
                f"B{a}{b} = " + " + ".join(f"f{a}{A} * f{b}{A}" for A in range(3))
                for a in range(3)
                for b in range(a, 3)
            ]
            lines.append("less = -2.0 * w_I2")
            for a in range(3):
                lines.append(f"add_identity(work, k, {_row(SQUARES + 6 * a)}, same + less * B{a}{a})")
                lines.append(f"add_rows(work, k, {_row(SQUARES + 6 * a)}, less, (c00, c01, c02, c11, c12, c22))")
            for pair, (a, b) in enumerate(((0, 1), (0, 2), (1, 2))):
                lines.append(f"add_diagonal(work, k, {_row(MODULI + 9 * pair)}, less * B{a}{b})")
        else:
            lines += [f"add_identity(work, k, {_row(SQUARES + 6 * a)}, same)" for a in range(3) if s.I1 in has]
        for fibre in (s.I4a, s.I4b):
            if fibre in has:
                name = str(fibre)[-1]
                bend = self._w(fibre, fibre)
                lines += [f"bend = 4.0 * {bend}"] if bend else []
                for a in range(3):
                    factor = f"2.0 * w_{fibre}" + (f" + bend * {name}n{a} * {name}n{a}" if bend else "")
                    lines.append(f"add_square(work, k, {_row(SQUARES + 6 * a)}, {factor}, {name})")
                for pair, (a, b) in enumerate(((0, 1), (0, 2), (1, 2))):
                    if bend:
                        row = _row(MODULI + 9 * pair)
                        lines.append(f"add_dyad(work, k, {row}, bend * {name}n{a} * {name}n{b}, {name})")
        if s.I8 in has:
            lines.append(
                "both = (2.0 * a0 * b0, a0 * b1 + a1 * b0, a0 * b2 + a2 * b0, "
                "2.0 * a1 * b1, a1 * b2 + a2 * b1, 2.0 * a2 * b2)"
            )
            lines += [f"add_rows(work, k, {_row(SQUARES + 6 * a)}, w_I8, both)" for a in range(3)]
        return lines + self._directions() + self._crossed() + (self._turned() if s.stretches[0] in has else [])

    def _crossed(self) -> list[str]:
        """Return lines that add ``W_st D_s D_t``, without terms ``s = t`` that were added before."""
        lines = []
        for k, p in enumerate(self.scalars):
            done = p in (s.I1, s.J, s.I4a, s.I4b)
            terms = []
            for q in self.scalars[k:]:
                w = self._w(p, q)
                if not w or (p == q and done):
                    continue
                terms.append((q, f"0.5 * {w}" if p == q else w))
            if not terms:
                continue
            factor = "2.0 * valid" if p in _TWICE else "valid"
            lines.append(f"add_both(work, k, {factor}, d_{p}, {_sum([(w, q) for q, w in terms])})")
        return lines

    def _turned(self) -> list[str]:
        """Return lines that add the terms of the rotation of principal directions.

        For two of them ``(u v + v u) (W_i - W_j)/(l_i - l_j)/2 + ...``, the quotient the mean of its limits at both
        ends where they meet.
        """
        lines = []
        for i, j in combinations(range(3), 2):
            li, lj = s.stretches[i], s.stretches[j]
            ii, jj, ij = (self._w(*pair) or "0.0" for pair in ((li, li), (lj, lj), (li, lj)))
            lines += [
                f"apart = {li} - {lj}",
                f"meet = 0.5 * ({ii} + {jj}) - {ij}",
                f"near = abs(apart) < 1e-5 * ({li} + {lj})",
                f"quotient = meet if near else (w_{li} - w_{lj}) / (1.0 if near else apart)",
                f"turn = (w_{li} + w_{lj}) / ({li} + {lj})",
                f"add_turned(work, k, 0.25 * quotient, 0.25 * turn, n{i}, v{i}, n{j}, v{j})",
            ]
        return lines
