"""Convex pieces, sphere covers, free space and clearances."""
