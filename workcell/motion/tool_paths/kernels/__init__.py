"""Compiled kernels of tracking a tool path (see `workcell.jit`)."""
