"""Measured tables: a paper's, or our own, measured again."""
