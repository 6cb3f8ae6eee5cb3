"""The compiled checker of branch-and-bound proofs, `workcell.ik.branch.checker.check`; no code of the search's."""
