"""Types of the arrays that go from module to module."""

from typing import Annotated, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# What is made an array of, in a signature that scene files read: NumPy's own alias is another object in each release.
Numbers: TypeAlias = Annotated[ArrayLike, "numbers in lists"]
