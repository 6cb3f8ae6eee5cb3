"""From configurations to continuous, collision-free, timed motion."""
