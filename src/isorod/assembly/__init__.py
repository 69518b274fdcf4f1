"""From element integrals to PETSc matrices and vectors."""
