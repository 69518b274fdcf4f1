"""The cost of derivatives: of a scene's measures by twenty of its parameters, relative to its solution."""
