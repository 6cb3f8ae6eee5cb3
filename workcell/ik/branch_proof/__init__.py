"""Compiled checker of branch-and-bound proofs (`workcell.ik.branch_check`); shares no code with the search."""
