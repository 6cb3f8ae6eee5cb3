"""The checker's doubles against extended precision: errors are far below the slack that rounds bounds outwards."""

import numpy as np
import pytest

from workcell.bench.reference.planting import planted_problem, random_chain
from workcell.ik.branch.arrays import inflation, problem_arrays
from workcell.ik.branch.checker.closure import Box, Robot, new_box, stand_at_centre
from workcell.ik.branch.checker.setup import longest, proof_robot
from workcell.ik.branch.checker.vectors import EPS
from workcell.jit import exact_kernel

Long = np.longdouble


@exact_kernel
def stand(robot: Robot, box: Box) -> None:
    """What the checker knows of the lines at the middle of a box, computed into it."""
    stand_at_centre(robot, box)


def extended(lines: np.ndarray, angles: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """(2, N, 9) lines of all joints as seen from the base and from the target, in extended precision."""
    count = len(lines)
    seen = np.zeros((2, count, 9), dtype=Long)
    for side in range(2):
        R, p = np.eye(3, dtype=Long), np.zeros(3, dtype=Long)
        if side == 1:
            R, p = goal[:9].astype(Long).reshape(3, 3), goal[9:].astype(Long)
        for k in range(count) if side == 0 else range(count - 1, -1, -1):
            z, o = lines[k, :3].astype(Long), lines[k, 3:6].astype(Long)
            z = z / np.sqrt(z @ z)
            value = Long(angles[k]) * (1 if side == 0 else -1)
            if side == 0:
                R, p = advance(R, p, z, o, value, lines[k, 9])
            for start in (3, 6):
                seen[side, k, start : start + 3] = R @ lines[k, start : start + 3].astype(Long) + p
            seen[side, k, :3] = R @ z
            if side == 1:
                R, p = advance(R, p, z, o, value, lines[k, 9])
    return seen


def advance(
    R: np.ndarray, p: np.ndarray, z: np.ndarray, o: np.ndarray, value: np.floating, slides: float
) -> tuple:
    """(R, p) times the exponential of a joint."""
    if slides:
        return R, p + value * (R @ z)
    K = np.array([[0, -z[2], z[1]], [z[2], 0, -z[0]], [-z[1], z[0], 0]], dtype=Long)
    E = np.eye(3, dtype=Long) + np.sin(value) * K + (1 - np.cos(value)) * (K @ K)
    return R @ E, p + R @ (o - E @ o)


@pytest.mark.skipif(np.finfo(Long).eps > 1e-18, reason="no extended precision on this machine")
def test_lines_err_by_far_less_than_the_slack() -> None:
    rng = np.random.default_rng(2)
    worst = 0.0
    for trial in range(60):
        robot = random_chain(rng, int(rng.integers(5, 9)), sliding=0.2)
        goal = ("pose", "axis", "position")[trial % 3]
        problem, _ = planted_problem(robot, rng, goal=goal)  # type: ignore[arg-type]
        length = longest(problem)
        proof = proof_robot(problem, np.array(inflation(problem)), length)
        root = problem_arrays(problem).root
        box = new_box(root.shape[1])
        ends = np.sort(rng.uniform(root[0], root[1], size=(2, root.shape[1])), axis=0)
        box.lower[:], box.upper[:] = ends
        stand(proof, box)
        truth = extended(np.array(proof.lines), np.array(box.centre), np.array(proof.goal))
        error = np.abs(np.array(box.sides)[:, :, :9] - truth).max()
        worst = max(worst, float(error) / (EPS * max(1.0, length) ** 2))
    assert worst < 1e-3
