"""What laws in a scene file are given that is no number: stiffnesses without bound, directions, energies as text."""

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isorod.errors import InputError
from isorod.files import values
from isorod.files.document import Place, shown

if TYPE_CHECKING:
    from isorod.material.active_muscle import ActiveMuscle
    from isorod.material.dissipative import Dissipative
    from isorod.material.fibre import Fibre
    from isorod.material.hyperelastic import Hyperelastic

# Folders with libraries that scene files may load, as in PATH.
_LIBRARIES = "ISOROD_LIBRARIES"

_DIRECTION = "a word, a vector [x, y, z], {helix = degrees}"


def bulk(place: Place, value: Any) -> float:
    """Return a bulk modulus: a number, or ``inf``."""
    if isinstance(value, float) and value == math.inf:
        return value
    return float(values.value_of(place, value, float))


def fibre(place: Place, value: Any) -> "Fibre | tuple[Fibre, Fibre]":
    """Return a direction of fibres, or those of two families."""
    if isinstance(value, list) and len(value) == 2:
        return _direction(place / 0, value[0]), _direction(place / 1, value[1])
    return _direction(place, value)


def _direction(place: Place, value: Any) -> "Fibre":
    if isinstance(value, dict):
        from isorod.material.fibre import helix

        if list(value) != ["helix"]:
            raise place.error(f"got {shown(value)} of {', '.join(value) or 'nothing'}, need {_DIRECTION}")
        return helix(float(values.value_of(place / "helix", value["helix"], float)))
    if isinstance(value, str):
        from isorod.material.fibre import WORDS

        if value not in WORDS:
            raise place.unknown(value, WORDS)
        return value
    return values.value_of(place, value, tuple[float, float, float])  # type: ignore[no-any-return]


def constants(place: Place, value: Any) -> dict[str, float]:
    """Return a table of numbers."""
    return {key: float(values.value_of(place / key, one, float)) for key, one in place.table(value).items()}


def kinds(place: Place, value: Any) -> dict[str, str]:
    """Return a table of texts."""
    return {key: str(values.value_of(place / key, one, str)) for key, one in place.table(value).items()}


def library(place: Place, value: Any) -> Path:
    """Return the path of a shared library, which is a program: from folders that the user has named alone."""
    path = Path(values.value_of(place, value, Path))
    folders = [Path(one).resolve() for one in os.environ.get(_LIBRARIES, "").split(os.pathsep) if one]
    if path.resolve().parent not in folders:
        raise place.error(f"{value}: a program; if you trust it, {_LIBRARIES}={path.resolve().parent} lets it run")
    return path


BULK = values.Kind(bulk, "a number, or inf")
FIBRE = values.Kind(fibre, f"{_DIRECTION}, or a list of two of these")
LIBRARY = values.Kind(library, "the name of a shared library in a folder of ISOROD_LIBRARIES")
CONSTANTS = values.Kind(constants, "a table of numbers")
VARIABLES = values.Kind(kinds, "a table of texts")


def hyperelastic(
    energy: str,
    constants: Mapping[str, float] | None = None,
    bulk: float | None = None,
    fibre: "Fibre | tuple[Fibre, Fibre]" = "tangent",
    prestressed: bool = False,
) -> "Hyperelastic":
    """Return the law of a stored energy per reference volume.

    Parameters
    ----------
    energy
        An expression such as `"mu/2*(I1bar - 3)"` of the invariants `I1`, `I2`, `J`, `I1bar`, `I2bar`, the squared
        fibre stretches `I4a`, `I4b` and `I8`, principal stretches `l1`, `l2`, `l3`, components `F00` to `F22` or `C00`
        to `C22`, and constants; with `+ - * / **`, `log`, `exp`, `sqrt`, `sin`, `cos`, `tanh`, `Max`, `Min`.
    constants
        The value of each constant in it.
    bulk
        Adds `bulk/2 log(J)**2` and what makes it free of pressure at rest; force / area, `inf` for an incompressible
        law.  Where not given, the energy is all there is.
    fibre
        Direction of the fibres `a`, or of `a` and `b`.
    prestressed
        Whether a stress at rest is meant to be there.
    """
    from isorod.files.expression import parsed
    from isorod.material.hyperelastic import Hyperelastic

    given = dict(constants or {})
    return Hyperelastic(parsed(energy, given), given, bulk, prestressed, fibre)


def _with_components(names: dict[str, Any]) -> dict[str, Any]:
    """Return names with those of the components of tensors."""
    each = [(name, one) for name, one in names.items() if hasattr(one, "shape")]
    return names | {f"{name}{i}{j}": one[i, j] for name, one in each for i in range(3) for j in range(3)}


def dissipative(
    energy: str,
    dissipation: str,
    state: Mapping[str, str],
    constants: Mapping[str, float] | None = None,
    bulk: float | None = None,
) -> "Dissipative":
    """Return the law of a stored energy and a dissipation potential of the rates of internal variables.

    Parameters
    ----------
    energy
        An expression such as `"mu*dot(dev(strain) - v, dev(strain) - v)"` of the tensor `strain`, ln(C)/2, the internal
        variables and constants, per reference volume; with `tr`, `dev` and `dot` of tensors, and what is known in the
        energy of `Hyperelastic`.
    dissipation
        One such as `"eta*dot(v_rate, v_rate)"` of their rates and constants.
    state
        The internal variables: name and `"scalar"`, `"symmetric"` or `"deviatoric"`, a tensor without trace.
    constants
        The value of each constant.
    bulk
        Adds `bulk/2 log(J)**2`; force / area, `inf` for an incompressible law.
    """
    from sympy import Symbol

    from isorod.files.expression import bounded, formula
    from isorod.material.dissipative import Dissipative, check_variables
    from isorod.material.symbols import internal, strain

    check_variables(state)
    names, lost = dict[str, Any](), dict[str, Any]()
    for name, kind in state.items():
        names[name], lost[f"{name}_rate"] = internal(name, kind)
    names, lost = _with_components(names | {"strain": strain}), _with_components(lost)
    given = dict(constants or {})
    for one in given:
        if one in names or one in lost or not one.isidentifier():
            raise InputError(f"constants: got the name {one!r}, need one that is not taken, of letters and digits")
    known = {one: Symbol(one, real=True) for one in given}
    stored = formula(energy, names | known, "energy", "a constant, strain, or one of state")
    rates = formula(dissipation, lost | known, "dissipation", "a constant, or a rate such as v_rate")
    return Dissipative(bounded(stored, "energy"), bounded(rates, "dissipation"), state, given, bulk)


def active_muscle(
    E: float,
    nu: float,
    curve: Any,
    sigma_max: float = 0.0,
    m1: float = 0.0,
    m2: float = 0.0,
    activation: float = 0.0,
    fibre: "Fibre" = "tangent",
) -> "ActiveMuscle":
    """Return muscle whose active fibres have a tension curve of one's own.

    Parameters
    ----------
    E, nu
        Young's modulus [force/area] and Poisson's ratio of the matrix.
    curve
        Points (stretch, tension), 1 a tension of `sigma_max`; cubic between them.
    sigma_max
        Active fibre stress where the curve is 1, force per reference area.
    m1, m2
        Passive fibre: stress factor [force/area] and exponent, neither negative.
    activation
        From 0 (at rest) to 1.
    fibre
        Direction of the fibres.
    """
    from isorod.material.active_muscle import ActiveMuscle

    return ActiveMuscle(E, nu, sigma_max, m1, m2, activation, fibre, curve)
