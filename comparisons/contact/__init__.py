"""Reference values of rods in contact, by closed forms, quadrature and rod theory; no solver, no contact code."""
