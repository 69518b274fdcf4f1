"""Rods in contact: reference values by closed forms, quadrature and rod theory, and what is solved beside them."""
