"""A family of configurations."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Family:
    """One element on meshes coarse to fine: a curve of a work-precision diagram."""

    label: str
    common: str
    meshes: tuple[str, ...]

    @property
    def arguments(self) -> tuple[str, ...]:
        """Arguments of each run."""
        return tuple(f"{self.common} {mesh}" for mesh in self.meshes)
