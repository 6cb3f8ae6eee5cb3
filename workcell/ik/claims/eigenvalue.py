"""An upper bound of the largest eigenvalue of a symmetric matrix, safe from rounding."""

from __future__ import annotations

import numpy as np

from workcell.pose import Array


def largest_eigenvalue(K: Array) -> float:
    """An upper bound on the largest eigenvalue of a symmetric matrix, whatever the library makes of it.

    For any V and w, K = V w V^T + E; by Ostrowski's theorem the first part's largest eigenvalue is at most that of w
    (or zero) times |V^T V|, and E adds its norm. What computing E rounds is below 1e-14 of the norms.
    """
    w, V = np.linalg.eigh(K)
    stretched = 1.0 + float(np.linalg.norm(V.T @ V - np.eye(len(K)))) + 1e-14
    rest = float(np.linalg.norm(K - (V * w) @ V.T)) + 1e-14 * float(np.linalg.norm(K))
    top = float(w.max())
    return (top * stretched if top > 0.0 else top * (2.0 - stretched)) + rest
