"""Joint-space branch and bound: a configuration, or a proof that there is none."""
