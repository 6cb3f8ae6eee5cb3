"""Compiled kernels of the joint-space branch and bound (`workcell.ik.branch.solver`), one idea a module."""
