"""What a user writes down: bodies, supports, loads and contacts."""

from isorod.model.load import BodyForce, SectionLoad
from isorod.model.model import Body, Model, Spin, Support

__all__ = ["Body", "BodyForce", "Model", "SectionLoad", "Spin", "Support"]
