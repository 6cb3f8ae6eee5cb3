"""The judge: whether a configuration is an answer. Shares nothing with the solvers."""
