"""HJCD-IK on NVIDIA Warp, with one thread a seed, on a GPU or Warp's CPU device.

The algorithm is that of `workcell.ik.hjcd.kernels.free`.

Needs the extra `workcell[gpu]`. Warp has no arrays of unknown size in a thread, so that kernels are built for a number
of joints (functions in functions, with types of that size), compiled when first launched and cached by Warp on disk.
"""
