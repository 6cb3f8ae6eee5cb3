"""Compiled kernels of the sampling solver. Importing a module here imports numba: solvers do so when first used, never before.

numba compiles on the first call and caches to disk (`__pycache__` beside the sources, or the user's cache folder where
that is read-only; `NUMBA_CACHE_DIR` overrides both). Its cache notices a change of the file that a kernel stands in,
not of the files it calls into: after editing a kernel, delete `__pycache__/*.nb?`.
"""
