"""Compiled kernels of planning and proof (see `workcell.jit`); callers import them when first used."""
