"""Benches of inverse kinematics."""
