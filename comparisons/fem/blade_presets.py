"""Configurations of the blade worth a name, as arguments of ``python -m comparisons.fem blade``."""

PRESETS: dict[str, str] = {}
