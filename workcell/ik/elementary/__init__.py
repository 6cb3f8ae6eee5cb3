"""Proofs of impossibility that need no solver, and the quick look that comes before them."""
