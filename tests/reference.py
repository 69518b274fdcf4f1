"""Converged three-dimensional values that several files compare with.

`python -m comparisons spring --level full` and `blade` recompute them.
"""

# The spring's force, extrapolated from three meshes of 64-node bricks; of 27-node ones alike, within 3e-5.
SPRING_FORCE = 6.09902

# The blade's ten lowest frequencies [Hz], from three meshes of 64-node bricks, up to 185,367 unknowns; three of
# 27-node bricks agree within 7e-5.
BLADE_FREQUENCIES = (0.18270, 0.75321, 1.37144, 1.87792, 2.10732, 3.51163, 4.35131, 5.26911, 5.63964, 6.88225)
