"""Compiled kernels of the sampling solver. Importing a module here imports numba: solvers do so when first used, never before.

numba compiles on the first call and caches to disk: in `__pycache__` beside the sources, or in the user's cache folder
where that is read-only; `NUMBA_CACHE_DIR` overrides both.
"""
