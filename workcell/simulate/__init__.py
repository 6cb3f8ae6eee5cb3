"""Execution of trajectories in MuJoCo."""
