"""Numbers as people read them, and words by which they ask."""

from typing import Literal

# Kinds of cells in files: what suits a body, those of degree 4 (`isorod.output.vtk.grid`), many small linear ones.
CELLS = "auto", "curved", "linear"

# Of Cauchy's stress: von Mises, the largest and the smallest principal stress, components in space, and through the
# section: normal to it, and the size of the shear in it.
Component = Literal["von_mises", "max_principal", "min_principal", "xx", "yy", "zz", "xy", "yz", "xz", "along", "shear"]


# Of the strains that laws with memory know: ``sqrt(2/3 e:e)``, and components in space at rest.
StateComponent = Literal["equivalent", "xx", "yy", "zz", "xy", "yz", "xz"]


# What fields are called where they are drawn, and in which unit they are.
FIELDS = {
    "von_mises": "von Mises stress\n(unit of E)",
    "cauchy": "Cauchy stress\n(unit of E)",
    "mean_stress": "mean stress\n(unit of E)",
    "contact_pressure": "contact pressure\n(unit of E)",
    "displacement": "displacement\n(length)",
    "velocity": "velocity\n(length/time)",
    "p": "accumulated plastic strain",
    "plastic_strain": "plastic strain",
    "dissipated": "dissipated energy\n(unit of E)",
}

# Where files keep the estimate, as records do.
STRESS_ERROR = "stress_error_estimate"


# Relative errors below this are rounding.
_NO_ERROR = 1e-10


def percent(error: float) -> str:
    """Return an estimate of an error, to one digit, rounding as 0."""
    if abs(error) < _NO_ERROR:
        return "0 %"
    return f"{float(f'{100.0 * error:.1g}'):g} %"


def stress_error(error: float | None) -> str:
    """Return what stands with pictures of stresses: their error (`isorod.checks.stresses`), or that none is known."""
    return f"stress error {'not estimated' if error is None else f'about {percent(error)}'}"


def duration(seconds: float) -> str:
    """Return a time in words: milliseconds, seconds, minutes or hours."""
    if seconds < 1.0:
        return f"{1e3 * seconds:.3g} ms"
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    if seconds < 3600.0:
        return f"{int(seconds / 60.0)} min {int(seconds % 60.0)} s"
    return f"{int(seconds / 3600.0):,} h {int(seconds % 3600.0 / 60.0)} min"
