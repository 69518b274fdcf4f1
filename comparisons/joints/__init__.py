"""Study: rods welded to rods and to finite element bodies, beside exact solutions; ``python -m comparisons.joints``."""
