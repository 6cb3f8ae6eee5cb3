"""Compiled kernels of live steps (see `workcell.jit`)."""
