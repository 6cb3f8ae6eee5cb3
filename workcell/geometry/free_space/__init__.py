"""Free space as cuboids and polytopes that are proved to hold nothing."""
