"""Inverse kinematics in the loop: a smooth, hard-guarded step every control tick.

RelaxedIK (Rakita et al., 2020).
"""
