"""Recordings read back from their files alone."""
