"""How far the links of an arm can move about one configuration (see `workcell.motion.proofs.on_model`)."""

from __future__ import annotations

import math

import numpy as np

from workcell.jit import exact_kernel
from workcell.kernels.chain import Tree, carried, forward_tree
from workcell.pose import Array


@exact_kernel
def link_motion(tree: Tree, spheres: Array, q: Array, half: Array, out: Array) -> None:
    """Into out (n + 1, n + 1): metres by which points of link b may move as seen from link a < b; zero elsewhere.

    Args:
        tree: a serial chain.
        spheres: (m, 6) centre in the link's frame (3), radius, an index, link.
        q, half: (n,) configuration and how far each joint may be from it.
    """
    n = q.shape[0]
    T = np.empty((n + 1, 12))
    forward_tree(tree, q, T)
    out[:] = 0.0
    for i in range(spheres.shape[0]):
        link, moved = int(spheres[i, 5]), 0.0
        x, y, z = carried(T, link, spheres, i)
        for j in range(link - 1, -1, -1):
            if tree.frames[j + 1, 12] != 0.0:
                moved += half[j]
            else:
                rx, ry, rz = x - T[j + 1, 9], y - T[j + 1, 10], z - T[j + 1, 11]
                ax, ay, az = T[j + 1, 2], T[j + 1, 5], T[j + 1, 8]
                u, v, w = ry * az - rz * ay, rz * ax - rx * az, rx * ay - ry * ax
                arm = math.sqrt(u * u + v * v + w * w) + spheres[i, 3]
                moved += 2.0 * math.sin(0.5 * min(half[j], math.pi)) * (arm + moved)
            out[j, link] = max(out[j, link], moved)
