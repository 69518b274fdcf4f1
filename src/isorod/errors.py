"""The errors a user can cause or meet; each message is one line: what, where, what would be right."""


class InputError(ValueError):
    """A value given by the user cannot be used."""


class FoldedRodError(InputError):
    """The map from disk x axis to space is not one-to-one."""


class SolveError(RuntimeError):
    """An analysis did not reach a solution."""
