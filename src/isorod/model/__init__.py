"""Model definition: bodies, supports (boundary conditions), loads, contacts and ties."""

from isorod.model.body import Body
from isorod.model.contact import Contact, Cylinder, Plane, Sphere
from isorod.model.load import BodyForce, LineLoad, PointLoad, Pressure, SectionLoad, Spin, Weight
from isorod.model.mean import MeanSupport
from isorod.model.model import Model
from isorod.model.moving import ObstacleMotion
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
    "LineLoad",
    "MeanSupport",
    "Model",
    "ObstacleMotion",
    "Plane",
    "PointLoad",
    "Pressure",
    "SectionLoad",
    "SolidSurface",
    "Sphere",
    "Spin",
    "Support",
    "Tie",
    "TriangleMesh",
    "Weight",
]
