"""Compiled checker of branch-and-bound proofs (`workcell.ik.branch.checker.check`); shares no code with the search."""
