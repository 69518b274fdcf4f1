"""Flags of the C compiler for the kernels that dolfinx' form compiler writes."""

# Sums may be taken in another order, which changes the last digits alone; NaN and infinity stay what they are.
# dolfinx 0.11 adds 81 products to each 3 x 3 block of an element matrix where 0.5.2 adds 27, and only with this leave
# does the compiler bring the factors together: its assembly then takes a third to a half of the time, 0.5.2's a tenth
# less than before.  What 0.11's is still slower by with high degrees is the order of its loops: the inner one runs down
# a column of the element matrix, of which rows are contiguous.  Sum factorisation gains nothing for matrices.
FAST = ("-O3", "-march=native", "-g0", "-funsafe-math-optimizations", "-fno-math-errno")
