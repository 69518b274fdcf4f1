"""Mutation test: small wrong changes drawn by chance, and the share of them that the tests catch (`make mutants`)."""
