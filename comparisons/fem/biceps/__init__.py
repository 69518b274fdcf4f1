"""The biceps by finite elements: two bodies in contact, at rest and in motion."""
