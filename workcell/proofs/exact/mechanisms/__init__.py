"""`mechanism/1` and `mechanism_cost/1` (section 12): rotations of links, tied by multipliers."""
