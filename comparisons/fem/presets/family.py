"""A family of configurations."""

from collections.abc import Callable
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


def families(*options: str) -> Callable[..., Family]:
    """Return the function that makes a family of a label, common options, and meshes: a number for each option.

    ``grading`` is that of all its meshes.
    """

    def family(label: str, common: str, *meshes: tuple[int, ...], grading: float = 1.0) -> Family:
        graded = "" if grading == 1.0 else f" --grading {grading:g}"
        texts = (" ".join(f"--{name} {n}" for name, n in zip(options, mesh, strict=True)) for mesh in meshes)
        return Family(label, common, tuple(text + graded for text in texts))

    return family


wires = families("around", "layers")
blades = families("along", "across", "layers")
