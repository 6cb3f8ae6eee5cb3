"""The kernels that are launched: descend a batch of seeds, rank it, polish copies of the best, pick winners."""
# mypy: ignore-errors

import functools
from types import SimpleNamespace

import warp as wp

from workcell.ik.hjcd.gpu.chain import HUGE, D, Target, chain
from workcell.ik.hjcd.gpu.descent import descent
from workcell.ik.hjcd.gpu.newton import newton


@wp.kernel(enable_backward=False)
def rank(cost: wp.array2d(dtype=D), kept: wp.array2d(dtype=int)):
    """For costs (k, b) the indices kept (k, m) of each row's m smallest, in order; equal ones by index."""
    i, j = wp.tid()
    own = cost[i, j]
    place = int(0)  # noqa: RUF046, UP018
    for other in range(cost.shape[1]):
        if cost[i, other] < own or (cost[i, other] == own and other < j):
            place += 1
    if place < kept.shape[1]:
        kept[i, place] = j


@functools.cache
def programs(n: int) -> SimpleNamespace:
    """The kernels for n joints: `descend`, `copy`, `polish`, `winners`; `Vector` is the type of a configuration."""
    Vector, descend_one, polish_one = chain(n).Vector, descent(n), newton(n)
    N = wp.constant(n)
    module = f"workcell.ik.hjcd.gpu.joints{n}"
    # Loops over joints stay loops: unrolled, they take minutes to compile for long chains.
    options = {"max_unroll": 0, "enable_backward": False}

    @wp.kernel(module=module)
    def descend(
        frames: wp.array2d(dtype=D), bounds: wp.array2d(dtype=D), targets: wp.array(dtype=Target),
        sweeps: int, q: wp.array2d(dtype=Vector), cost: wp.array2d(dtype=D),
    ):  # fmt: skip
        """Phase one on configurations q (k, b) for k targets, in place."""
        i, j = wp.tid()
        reached, square = descend_one(frames, bounds, targets[i], sweeps, q[i, j])
        q[i, j] = reached
        # A residual that is no number (a target that is none) ranks last.
        cost[i, j] = wp.where(wp.isfinite(square), square, HUGE)

    @wp.kernel(module=module)
    def copy(
        bounds: wp.array2d(dtype=D), q: wp.array2d(dtype=Vector), kept: wp.array2d(dtype=int), copies: int,
        spread: D, seed: int, out: wp.array2d(dtype=Vector),
    ):  # fmt: skip
        """The kept configurations, each `copies` times, all but the first perturbed normally within the limits."""
        i, j = wp.tid()
        near = q[i, kept[i, j // copies]]
        if j % copies != 0:
            state = wp.rand_init(seed, i * out.shape[1] + j)
            for k in range(N):
                noise = D(wp.randn(state)) * spread * (bounds[1, k] - bounds[0, k])
                near[k] = wp.min(wp.max(near[k] + noise, bounds[0, k]), bounds[1, k])
        out[i, j] = near

    @wp.kernel(module=module)
    def polish(
        frames: wp.array2d(dtype=D), bounds: wp.array2d(dtype=D), targets: wp.array(dtype=Target),
        accuracy: D, q: wp.array2d(dtype=Vector), cost: wp.array2d(dtype=D),
    ):  # fmt: skip
        """Phase two on configurations q (k, b) for k targets, in place."""
        i, j = wp.tid()
        reached, square = polish_one(frames, bounds, targets[i], accuracy, q[i, j])
        q[i, j] = reached
        cost[i, j] = wp.where(wp.isfinite(square), square, HUGE)

    @wp.kernel(module=module)
    def winners(
        q: wp.array2d(dtype=Vector), cost: wp.array2d(dtype=D), best: wp.array(dtype=Vector),
        least: wp.array(dtype=D),
    ):  # fmt: skip
        """The configuration with the smallest cost of each target."""
        i = wp.tid()
        for j in range(cost.shape[1]):
            if j == 0 or cost[i, j] < least[i]:
                least[i] = cost[i, j]
                best[i] = q[i, j]

    wp.set_module_options(options, module=wp.get_module(module))
    return SimpleNamespace(Vector=Vector, descend=descend, copy=copy, polish=polish, winners=winners)
