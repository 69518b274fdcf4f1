"""What proves a result, or refuses it."""
