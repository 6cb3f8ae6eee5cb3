"""Benches of live inverse kinematics: RelaxedIK's tables, guards, other packages beside it."""
