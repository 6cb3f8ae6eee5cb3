"""Proofs that no configuration solves a problem, checked by a program that shares nothing with who found them."""
