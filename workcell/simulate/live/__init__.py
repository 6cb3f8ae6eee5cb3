"""Tools that follow goals live in a simulation: asked for every control tick, told, and shown."""
