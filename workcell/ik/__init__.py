"""Inverse kinematics: problems, solvers, certificates, and the verification that alone awards `SOLVED`."""
