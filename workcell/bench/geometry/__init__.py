"""Benches of covers, clearances and free space."""
