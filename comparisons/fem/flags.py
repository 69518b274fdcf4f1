"""Flags of the C compiler for the kernels that dolfinx' form compiler writes."""

# Sums may be taken in another order, which changes the last digits alone; NaN and infinity stay what they are.
# dolfinx 0.11 adds 81 products to each 3 x 3 block of an element matrix where 0.5.2 adds 27, and only with this leave
# does the compiler bring the factors together: its kernels then take a third of the time, those of 0.5.2 two thirds.
FAST = ("-O3", "-march=native", "-g0", "-funsafe-math-optimizations", "-fno-math-errno")
