"""Rods as full 3-D continua, solved through surface control points alone.

What a script needs is here by name: rods (`helix`, `circle`, ...), models (`Space`, `Body`, `Model`, ...) and the
analyses (`statics.solve`, `modal.solve`, `dynamics.solve`).  Each is loaded when it is first asked for.
"""

import sys
from importlib import import_module, util
from importlib.abc import MetaPathFinder
from os.path import exists
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from isorod import dynamics as dynamics
    from isorod import errors as errors
    from isorod import modal as modal
    from isorod import options as options
    from isorod import scenes as scenes
    from isorod import statics as statics
    from isorod.dynamics import History as History
    from isorod.errors import FoldedRodError as FoldedRodError
    from isorod.errors import InputError as InputError
    from isorod.errors import SolveError as SolveError
    from isorod.geometry.axis import Axis as Axis
    from isorod.geometry.center_line import arc as arc
    from isorod.geometry.center_line import helix as helix
    from isorod.geometry.center_line import nurbs as nurbs
    from isorod.geometry.center_line import polyline as polyline
    from isorod.geometry.center_line import straight as straight
    from isorod.geometry.line import CenterLine as CenterLine
    from isorod.geometry.rod import Rod as Rod
    from isorod.geometry.section import airfoil as airfoil
    from isorod.geometry.section import circle as circle
    from isorod.geometry.section import ellipse as ellipse
    from isorod.geometry.section import flower as flower
    from isorod.geometry.section import from_file as section_from_file  # noqa: F401
    from isorod.geometry.section import from_points as section_from_points  # noqa: F401
    from isorod.geometry.section import naca as naca
    from isorod.geometry.section import rounded_rectangle as rounded_rectangle
    from isorod.material import LinearElastic as LinearElastic
    from isorod.material import Material as Material
    from isorod.material import NeoHookean as NeoHookean
    from isorod.material.active_muscle import ActiveMuscle as ActiveMuscle
    from isorod.material.gent import Gent as Gent
    from isorod.material.holzapfel_gasser_ogden import HolzapfelGasserOgden as HolzapfelGasserOgden
    from isorod.material.hyperelastic import Hyperelastic as Hyperelastic
    from isorod.material.mooney_rivlin import MooneyRivlin as MooneyRivlin
    from isorod.material.muscle import Muscle as Muscle
    from isorod.material.ogden import Ogden as Ogden
    from isorod.material.orthotropic import Orthotropic as Orthotropic
    from isorod.material.orthotropic import TransverselyIsotropic as TransverselyIsotropic
    from isorod.material.orthotropic_kirchhoff import OrthotropicKirchhoff as OrthotropicKirchhoff
    from isorod.material.st_venant_kirchhoff import StVenantKirchhoff as StVenantKirchhoff
    from isorod.material.yeoh import Yeoh as Yeoh
    from isorod.modal import Modes as Modes
    from isorod.model import Body as Body
    from isorod.model import BodyForce as BodyForce
    from isorod.model import Contact as Contact
    from isorod.model import Cylinder as Cylinder
    from isorod.model import Model as Model
    from isorod.model import Plane as Plane
    from isorod.model import Pressure as Pressure
    from isorod.model import SectionLoad as SectionLoad
    from isorod.model import Sphere as Sphere
    from isorod.model import Spin as Spin
    from isorod.model import Support as Support
    from isorod.model import TriangleMesh as TriangleMesh
    from isorod.output.matrices import Matrices as Matrices
    from isorod.output.matrices import matrices as matrices
    from isorod.output.section_properties import SectionProperties as SectionProperties
    from isorod.output.section_properties import section_properties as section_properties
    from isorod.output.shape import show as show
    from isorod.space import Space as Space
    from isorod.statics import Equilibrium as Equilibrium

# The one place of the version: pyproject.toml reads it here, and CITATION.cff repeats it with the date.
__version__ = "0.2.0"

# Where each name is, and under which where that is another: what type checkers read above.
_OFFERED = {
    "ActiveMuscle": "isorod.material.active_muscle",
    "Axis": "isorod.geometry.axis",
    "Body": "isorod.model",
    "BodyForce": "isorod.model",
    "CenterLine": "isorod.geometry.line",
    "Contact": "isorod.model",
    "Cylinder": "isorod.model",
    "Equilibrium": "isorod.statics",
    "FoldedRodError": "isorod.errors",
    "Gent": "isorod.material.gent",
    "History": "isorod.dynamics",
    "HolzapfelGasserOgden": "isorod.material.holzapfel_gasser_ogden",
    "Hyperelastic": "isorod.material.hyperelastic",
    "InputError": "isorod.errors",
    "LinearElastic": "isorod.material",
    "Material": "isorod.material",
    "Matrices": "isorod.output.matrices",
    "Model": "isorod.model",
    "Modes": "isorod.modal",
    "MooneyRivlin": "isorod.material.mooney_rivlin",
    "Muscle": "isorod.material.muscle",
    "NeoHookean": "isorod.material",
    "Orthotropic": "isorod.material.orthotropic",
    "OrthotropicKirchhoff": "isorod.material.orthotropic_kirchhoff",
    "Ogden": "isorod.material.ogden",
    "Plane": "isorod.model",
    "Pressure": "isorod.model",
    "Rod": "isorod.geometry.rod",
    "SectionLoad": "isorod.model",
    "SectionProperties": "isorod.output.section_properties",
    "SolveError": "isorod.errors",
    "Space": "isorod.space",
    "Sphere": "isorod.model",
    "Spin": "isorod.model",
    "StVenantKirchhoff": "isorod.material.st_venant_kirchhoff",
    "Support": "isorod.model",
    "TransverselyIsotropic": "isorod.material.orthotropic",
    "TriangleMesh": "isorod.model",
    "Yeoh": "isorod.material.yeoh",
    "airfoil": "isorod.geometry.section",
    "arc": "isorod.geometry.center_line",
    "circle": "isorod.geometry.section",
    "ellipse": "isorod.geometry.section",
    "flower": "isorod.geometry.section",
    "helix": "isorod.geometry.center_line",
    "matrices": "isorod.output.matrices",
    "naca": "isorod.geometry.section",
    "nurbs": "isorod.geometry.center_line",
    "polyline": "isorod.geometry.center_line",
    "rounded_rectangle": "isorod.geometry.section",
    "section_from_file": "isorod.geometry.section:from_file",
    "section_from_points": "isorod.geometry.section:from_points",
    "section_properties": "isorod.output.section_properties",
    "show": "isorod.output.shape",
    "straight": "isorod.geometry.center_line",
}
_MODULES = ("dynamics", "errors", "modal", "options", "scenes", "statics")

# Type checkers would take any name for one that is there.
if not TYPE_CHECKING:
    __all__ = [*_OFFERED, *_MODULES]

    def __getattr__(name: str) -> Any:
        """Load what is offered under a name."""
        if name in _MODULES:
            return import_module(f"isorod.{name}")
        if name not in _OFFERED:
            raise AttributeError(f"module 'isorod' has no attribute {name!r}", name=name, obj=sys.modules["isorod"])
        place, _, other = _OFFERED[name].partition(":")
        found = getattr(import_module(place), other or name)
        globals()[name] = found
        return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_OFFERED, *_MODULES})


class _MpiFirst(MetaPathFinder):
    """Loads MPI when PETSc is first asked for: the wheels' PETSc finds its library only if that is there already."""

    def find_spec(self, fullname: str, *_: Any) -> None:
        """Find nothing itself."""
        if fullname in ("petsc4py", "slepc4py"):
            sys.meta_path.remove(self)
            import_module("mpi4py.MPI")


class _NumbaAlone(MetaPathFinder):
    """Keeps Numba from loading what it can do without, which takes as long as all the rest of it.

    That is `coverage`, unless it is at work, and `yaml`, unless there is a file of settings to be read with it.
    """

    def find_spec(self, fullname: str, *_: Any) -> None:
        """Find nothing, and raise `ModuleNotFoundError` where it is Numba that asks."""
        if fullname == "numba.core.registry":
            sys.meta_path.remove(self)
        elif "numba" in sys.modules and (fullname == "coverage" or (fullname == "yaml" and not exists(_SETTINGS))):
            raise ModuleNotFoundError(f"{fullname}: Numba does without", name=fullname)


_SETTINGS = ".numba_config.yaml"
if "numba" not in sys.modules:
    sys.meta_path.insert(0, _NumbaAlone())
if util.find_spec("dolfinx_solver"):
    sys.meta_path.insert(0, _MpiFirst())
