"""Queries of several goals on a kinematic tree, and the judge of their answers."""
