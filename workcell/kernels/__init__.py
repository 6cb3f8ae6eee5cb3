"""Compiled kernels of chains and distances, for every layer above (see `workcell.jit`)."""
