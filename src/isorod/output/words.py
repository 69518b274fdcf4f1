"""Formatted numbers, and names of components, fields and cells."""

from typing import Literal

# Kinds of cells in files: chosen for the body, of degree 4 (`isorod.output.vtk.grid`), many small linear ones.
CELLS = "auto", "curved", "linear"

# Scalars of Cauchy's stress: von Mises, largest and smallest principal stress, components in space, and those on the
# section: normal stress, and magnitude of the shear stress.
Component = Literal["von_mises", "max_principal", "min_principal", "xx", "yy", "zz", "xy", "yz", "xz", "along", "shear"]


# Scalars of strains of laws with memory: ``sqrt(2/3 e:e)``, and components in space at rest.
StateComponent = Literal["equivalent", "xx", "yy", "zz", "xy", "yz", "xz"]


# Titles of fields in pictures, with units.
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

# Name of the estimate in files and records.
STRESS_ERROR = "stress_error_estimate"


# Relative errors below this are round-off.
_NO_ERROR = 1e-10


def percent(error: float) -> str:
    """Return an estimate of an error, to one digit; 0 at round-off."""
    if abs(error) < _NO_ERROR:
        return "0 %"
    return f"{float(f'{100.0 * error:.1g}'):g} %"


def stress_error(error: float | None) -> str:
    """Return the note on pictures of stresses: their estimated error (`isorod.checks.stresses`), if known."""
    return f"stress error {'not estimated' if error is None else f'about {percent(error)}'}"


def duration(seconds: float) -> str:
    """Return a formatted time: milliseconds, seconds, minutes or hours."""
    if seconds < 1.0:
        return f"{1e3 * seconds:.3g} ms"
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    if seconds < 3600.0:
        return f"{int(seconds / 60.0)} min {int(seconds % 60.0)} s"
    return f"{int(seconds / 3600.0):,} h {int(seconds % 3600.0 / 60.0)} min"
