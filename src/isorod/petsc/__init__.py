"""PETSc matrices and solvers that know no model."""
