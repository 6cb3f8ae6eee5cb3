"""Compiled kernels of the joint-space branch and bound (`workcell.ik.branch`), one idea a module."""
