"""How kernels are compiled, and the structures they share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from workcell.pose import Array

_STAMP = tuple(
    (file.name, file.stat().st_mtime, file.stat().st_size)
    for file in sorted(Path(__file__).parent.glob("*.py"))
)

Function = TypeVar("Function", bound=Callable[..., object])

# Everything but "no NaN, no infinity": a step that breaks down must be seen as one.
_FAST = {"contract", "reassoc", "nsz", "arcp"}


def kernel(function: Function) -> Function:
    """Compile an entry point on first use, cached on disk, without the interpreter's lock."""
    compiled: Function = _compiled(function, nogil=True)
    return compiled


def inner(function: Function) -> Function:
    """Compile what only other kernels call: without the wrappers for Python and C, which cost compile time."""
    compiled: Function = _compiled(function, no_cpython_wrapper=True, no_cfunc_wrapper=True)
    return compiled


def _compiled(function: Any, **options: bool) -> Any:
    options_for_all = {"error_model": "numpy", "fastmath": _FAST, **options}
    try:
        return _stamped(njit(cache=True, **options_for_all)(function))
    except RuntimeError:
        # Neither the package's folder nor the user's cache can be written to: compile in every process.
        return njit(**options_for_all)(function)


def _stamped(compiled: Any) -> Any:
    """Let a cached kernel go stale with any file of this folder: numba looks at the kernel's own file only, not at those
    it calls into. There is no public way to say so; without the attribute numba's own rule holds.
    """
    cache_file: Any = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if hasattr(cache_file, "_source_stamp"):
        cache_file._source_stamp = _STAMP
    return compiled


class Arm(NamedTuple):
    """A serial chain for the kernels, every joint axis turned into its frame's z.

    Attributes:
        frames: (n + 2, 13) base, joints and tool: rotation (9, row-major) and position (3) in the frame before, then 1
            for a prismatic joint.
        bounds: (3, n) lower and upper limits, and 1 where whole turns fit in between.
    """

    frames: Array
    bounds: Array


class World(NamedTuple):
    """The robot's spheres and the obstacles.

    Attributes:
        spheres: (m, 6) centre in the link's frame, radius, index in the cover, link; sorted by link.
        balls: (n + 1, 6) for each link a ball around its spheres (centre, radius) and their first and last row.
        obstacles: (k, 19) kind, centre (3), rotation (9), size (3), bounding radius, first and last row in `faces`.
        faces: (f, 13) triangles of hulls in the hull's frame: outward unit normal (3), offset, corners (9).
        required: metres of clearance that a solution keeps.
    """

    spheres: Array
    balls: Array
    obstacles: Array
    faces: Array
    required: float


class Work(NamedTuple):
    """Scratch of one query: frames, Jacobian, residual and the vectors of a step (see `scratch`)."""

    T: Array
    J: Array
    e: Array
    A: Array
    y: Array
    step: Array
    trial: Array
    gradient: Array
    newton: Array
    H: Array
    column: Array


@inner
def scratch(n: int) -> Work:
    """Room for a chain of n joints."""
    return Work(
        np.empty((n + 2, 12)),
        np.empty((6, n)),
        np.empty(6),
        np.empty((6, 6)),
        np.empty(6),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty((n, n)),
        np.empty(n),
    )


RandomState = NDArray[np.uint64]
_GAMMA, _MIX1, _MIX2 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)  # fmt: skip
_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


@inner
def uniform(random: RandomState) -> float:
    """The next number in [0, 1) of the splitmix64 stream (Steele, Lea, Flood, OOPSLA 2014) held in `random` (1,)."""
    random[0] += _GAMMA
    z = random[0]
    z = (z ^ (z >> _S30)) * _MIX1
    z = (z ^ (z >> _S27)) * _MIX2
    z = z ^ (z >> _S31)
    return float(z >> _S11) * (1.0 / 9007199254740992.0)
