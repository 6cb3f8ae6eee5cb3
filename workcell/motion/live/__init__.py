"""Inverse kinematics in the loop: a step for every control tick, smooth and hard-guarded (RelaxedIK, Rakita et al. 2020)."""
