"""Ways of mechanisms: goals of several frames followed waypoint by waypoint, checked between them, and timed."""
