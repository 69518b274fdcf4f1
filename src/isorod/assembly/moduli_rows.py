"""Places of a block's moduli in the matrices that are multiplied with products of section functions."""

from itertools import combinations_with_replacement, product

import numpy as np

from isorod.arrays import Index


def moduli_rows() -> tuple[Index, Index]:
    """Return the matrix, of four, and its row at a place for each of a block's 45 rows of moduli.

    A block has nine rows of each of three pairs of components, then six of each component alone; a matrix's rows are
    counted direction by direction (`isorod.assembly.stiffness_kernel.moduli`).
    """
    places = []
    for pair, (a, b) in enumerate(((0, 1), (0, 2), (1, 2))):
        for d, c in product(range(3), repeat=2):
            if d < 2 and c < 2:
                places.append((0, 4 * pair + 2 * d + c))
            elif d == c:
                places.append((3, pair))
            else:
                places.append((2, 2 * (3 * a + b) + d if c == 2 else 2 * (3 * b + a) + c))
    for a in range(3):
        for d, c in combinations_with_replacement(range(3), 2):
            if c < 2:
                places.append((1, 3 * a + d + c))
            else:
                places.append((3, 3 + a) if d == 2 else (2, 8 * a + d))
    matrix, row = np.array(places).T.copy()
    return matrix, row
