"""What derivatives cost: those of what a scene measures by twenty of its numbers, beside solving it."""
