"""A proof that goes with a configuration: a box around it in which a solution is, and all of which is clear."""
