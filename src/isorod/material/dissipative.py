"""A law from two user-defined potentials: stored energy and dissipation."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from isorod.errors import InputError
from isorod.material.isochoric import Isochoric, check_written
from isorod.material.law import Material
from isorod.material.memory import Timed
from isorod.material.points import STATES, Compiled
from isorod.material.proof import check_waves

# Number of components of each kind of variable in the state.
KINDS = {"scalar": 1, "symmetric": 6, "deviatoric": 6}

# Names of other fields in records and files.
_TAKEN = "dissipated", "displacement", "velocity", "pressure", "contact_pressure", "cauchy", "von_mises", "mean_stress"

# Strains and times of the steps in which a law is checked.
_STRAIN, _TIMES = 0.02, (1e-3, 1.0, 1e3)

_CHECKED: set[Any] = set()


def check_variables(variables: Mapping[str, str]) -> None:
    """Raise `InputError` if names or kinds of internal variables are invalid."""
    for name, kind in variables.items():
        if not name.isidentifier():
            raise InputError(f"state: got the name {name!r}, need one of letters and digits")
        if name in _TAKEN:
            raise InputError(f"state: got the name {name!r}, which records and files of fields have; take another")
        if kind not in KINDS:
            raise InputError(f"state {name}: got {kind!r}, need one of {', '.join(KINDS)}")
    width = sum(KINDS[kind] for kind in variables.values())
    if not 1 <= width <= STATES:
        raise InputError(f"state: need 1 to {STATES} numbers, 6 for each tensor; got {width}")


@dataclass(frozen=True, eq=False)
class Dissipative(Timed, Isochoric):
    """A law from its stored energy and a dissipation potential of the rates of internal variables.

    The energy depends on the logarithmic strain ``ln(C)/2`` and is therefore objective.  A step minimises
    ``W(strain, a) + t phi((a - a_n)/t)``: an error of first order in its time ``t``.  Stress, the symmetric moduli and
    the local Newton iterations are derived from the two potentials, and checked when the law is made.

    Parameters
    ----------
    definition
        The stored energy, a SymPy expression of `isorod.material.symbols.strain`, internal variables and
        constants, per reference volume.
    dissipation
        A SymPy expression of rates and constants, convex, with its minimum 0 at zero rates and a second derivative
        there, which yield stresses and Norton's power law lack (`isorod.material.plastic`, `isorod.material.viscous`).
    variables
        Kind of each variable by its name: ``"scalar"``, ``"symmetric"`` or ``"deviatoric"``, a tensor without trace.
        Its symbols and those of its rate are `isorod.material.symbols.internal`.  All are zero at rest.
    parameters
        Value of each constant, by its symbol or name.
    bulk
        If given, ``bulk/2 (ln J)^2`` is added to the energy; force / area, infinite for an incompressible law.

    Raises
    ------
    InputError
        If a symbol is not known, a constant has no value, or a check fails.
    """

    definition: Any
    dissipation: Any
    variables: Mapping[str, str]
    parameters: Mapping[Any, float] = field(default_factory=dict)
    bulk: float | None = None  # type: ignore[assignment]

    clock: ClassVar[int] = 0

    def __post_init__(self) -> None:
        check_written(self.parameters, self.bulk)
        check_variables(self.variables)
        Material.__post_init__(self)
        self._prove()

    def _check(self) -> None:
        """Accept all constants: the energy is checked."""

    @cached_property
    def _text(self) -> str:
        from isorod.material.dissipative_source import free_of, source
        from isorod.material.symbols import bulk, internal, trace

        pairs, places, traces, first = list[Any](), list[int](), list[tuple[int, int, int]](), 0
        for name, kind in self.variables.items():
            variable, rate = internal(name, kind)
            if kind == "scalar":
                pairs, places = [*pairs, (variable, rate)], [*places, first]
            else:
                kept = range(5 if kind == "deviatoric" else 6)
                at = [(i, j) for i in range(3) for j in range(i, 3)]
                pairs += [(variable[at[k]], rate[at[k]]) for k in kept]
                places += [first + k for k in kept]
                traces += [(first + 5, first, first + 3)] if kind == "deviatoric" else []
            first += KINDS[kind]
        symbols = self._symbols
        energy, lost = self.definition, self.dissipation
        for what, one, known in (
            ("energy", energy, [variable for variable, _ in pairs]),
            ("dissipation", lost, [rate for _, rate in pairs]),
        ):
            if unknown := free_of(one, [*known, *symbols]):
                raise InputError(f"{what}: {', '.join(unknown)} is neither a constant that is given nor known there")
        if set(trace.free_symbols) & lost.free_symbols:
            raise InputError("dissipation: it depends on rates and constants alone; got the strain")
        if self.splits:
            energy, symbols = energy + bulk / 2 * trace**2, (*symbols, bulk)
        return source(energy, lost, pairs, places, traces, symbols)

    @cached_property
    def _symbols(self) -> tuple[Any, ...]:
        from sympy import Symbol

        free = {*self.definition.free_symbols, *self.dissipation.free_symbols}
        named = {str(one): one for one in free}
        return tuple(named.get(str(one), Symbol(str(one))) for one in self.parameters)

    @property
    def states(self) -> dict[str, int]:  # type: ignore[override]
        """Number of components of each variable in the state; of tensors 00, 01, 02, 11, 12, 22."""
        return {name: KINDS[kind] for name, kind in self.variables.items()}

    @property
    def splits(self) -> bool:  # type: ignore[override]
        """Whether it has a volumetric energy."""
        return self.bulk is not None

    @cached_property
    def lame(self) -> float:
        """Factor of the volumetric energy, force / area."""
        return 0.0 if self.bulk is None else self.bulk

    @property
    def values(self) -> tuple[float, ...]:
        """The time of the step, and the constants."""
        return self.step, *(float(value) for value in self.parameters.values())

    @property
    def compiled(self) -> Compiled:
        """The addresses of its compiled functions."""
        from isorod.material.written import of_text

        return of_text(self._text)

    @property
    def identity(self) -> str:
        """Its name and potentials."""
        return f"{type(self).__name__} {self.definition} {self.dissipation} {self.variables} {self.constants.tolist()}"

    def _prove(self) -> None:
        """Check the potentials at rest, at random rates, and in random steps.

        Raises
        ------
        InputError
            If there is a stress or a flow at rest; a rate gains energy; a step has no minimum; moduli are not the
            derivative of the stress; a plane wave at rest has no positive modulus.
        """
        key = self._text, self.constants.tobytes()
        if key in _CHECKED:
            return
        self._at_rates()
        self._at_rest()
        law = self.shear
        rest = np.eye(3)[None]
        scale = float(np.abs(law.tangent(rest)).max())
        check_waves("energy", law, scale)
        for time in _TIMES:
            self._in_steps(law, time, scale)
        _CHECKED.add(key)

    def _at_rest(self) -> None:
        """Check that at rest there is no stress, and nothing flows."""
        import sympy as sp

        energy = self.definition.subs(dict(zip(self._symbols, self.parameters.values(), strict=True)))
        free = energy.free_symbols
        slopes = [sp.diff(energy, one).subs(dict.fromkeys(free, 0)) for one in free]
        scale = max((abs(sp.diff(energy, one, 2).subs(dict.fromkeys(free, 0))) for one in free), default=0)
        if not all(abs(one) <= 1e-10 * scale for one in slopes):
            raise InputError("energy: stress and driving forces of the variables have to be zero at rest")

    def _at_rates(self) -> None:
        """Check that no rate gains energy."""
        import sympy as sp

        lost = self.dissipation.subs(dict(zip(self._symbols, self.parameters.values(), strict=True)))
        rates = sorted(lost.free_symbols, key=str)
        if not rates or lost.subs(dict.fromkeys(rates, 0)) != 0:
            raise InputError("dissipation: need one of rates, zero where nothing flows")
        bends = [sp.diff(lost, one, two).subs(dict.fromkeys(rates, 0)) for one in rates for two in rates]
        if any(one.has(sp.nan, sp.zoo, sp.oo) for one in bends):
            raise InputError(
                "dissipation: it has no second derivative where nothing flows; for a yield stress, or a power of "
                "stress, take Plastic, Viscoplastic or Creep"
            )
        power = sp.lambdify(rates, sum(one * sp.diff(lost, one) for one in rates), "numpy")
        rng = np.random.default_rng(0)
        for size in (1e-6, 1e-3, 1.0, 1e3):
            with np.errstate(all="ignore"):
                powers = np.broadcast_to(power(*(size * rng.normal(size=(len(rates), 2500)))), 2500)
            if not (powers >= 0.0).all():
                raise InputError("dissipation: some rates gain energy")

    @staticmethod
    def _in_steps(law: "Dissipative", time: float, scale: float) -> None:
        """Check the moduli in random steps of some time."""
        rng, now = np.random.default_rng(1), time
        F = np.tile(np.eye(3), (6, 1, 1))
        for _ in range(2):
            F = F + _STRAIN * rng.uniform(-1.0, 1.0, F.shape)
            timed = law.at(now)
            moduli, direction = timed.tangent(F), rng.uniform(-1.0, 1.0, F.shape)
            linear = np.einsum("naAbB,nbB->naA", moduli, direction)
            difference = (timed.stress(F + 1e-6 * direction) - timed.stress(F - 1e-6 * direction)) / 2e-6
            if not np.isfinite(difference).all():
                raise InputError(f"dissipation: in a step of time {time:g} its potential has no regular minimum")
            error = float(np.abs(difference - linear).max() / scale)
            if not error < 1e-5:
                raise InputError(f"energy: in a step of time {time:g} its moduli are off by {100.0 * error:.3g} %")
            law, now = law.advanced(F, now), now + time
