"""Compiled kernels of the sampling solver (see `workcell.jit`)."""
