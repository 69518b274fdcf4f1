"""Model definition: bodies, supports (boundary conditions), loads, contacts and ties."""

from isorod.model.body import Body
from isorod.model.contact import Contact, Cylinder, Plane, Sphere
from isorod.model.load import BodyForce, Pressure, SectionLoad, Spin
from isorod.model.model import Model
from isorod.model.support import Support
from isorod.model.tie import EndFace, LateralSurface, SolidSurface, Tie
from isorod.model.triangle_mesh import TriangleMesh

__all__ = [
    "Body",
    "BodyForce",
    "Contact",
    "Cylinder",
    "EndFace",
    "LateralSurface",
    "Model",
    "Plane",
    "Pressure",
    "SectionLoad",
    "SolidSurface",
    "Sphere",
    "Spin",
    "Support",
    "Tie",
    "TriangleMesh",
]
