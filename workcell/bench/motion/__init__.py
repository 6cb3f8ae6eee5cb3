"""Benches of plans, tool paths and timing."""
