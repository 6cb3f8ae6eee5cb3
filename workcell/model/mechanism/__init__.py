"""Mechanisms: every joint of a compiled model, whatever its kind, and what ties them: trees, loops, couplings."""
