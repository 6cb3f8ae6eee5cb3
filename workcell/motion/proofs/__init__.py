"""Proofs that a whole motion is clear, and the judge of paths."""
