"""Flags of the C compiler for the kernels that dolfinx' form compiler writes."""

# Sums may be reordered, which changes the last digits alone; NaN and infinity are kept.  dolfinx 0.11 adds 81 products
# to each 3 x 3 block of an element matrix where 0.5.2 adds 27, and the compiler factors them only with these flags: its
# assembly then takes a third to a half of the time, that of 0.5.2 a tenth less.  With high degrees 0.11 remains slower
# by the order of its loops: the inner one runs along columns of the element matrix, whose rows are contiguous.  Sum
# factorisation gains nothing for matrices.
FAST = ("-O3", "-march=native", "-g0", "-funsafe-math-optimizations", "-fno-math-errno")
