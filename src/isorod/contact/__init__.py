"""How contact of lateral surfaces is computed."""
