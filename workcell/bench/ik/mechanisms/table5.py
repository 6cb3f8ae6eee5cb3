"""Section X-B of IKSPARK: poses of a platform on six legs, and Dietmaier's forty postures (Table V).

Poses are drawn as in the paper. Its printed limits of the legs, 0.0001 and 1, do not fit its geometry, whose legs are
0.24 to 2.51 m long at these poses; ours are 0.2 to 2.6 m. No collisions, as in the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import get_args

import numpy as np

from workcell.bench.ik.mechanisms.answers import TIGHT, answers, counted, mechanism_row, worst
from workcell.bench.ik.mechanisms.postures import LEG_LENGTHS, POSTURES
from workcell.bench.rows import Bench, Row
from workcell.ik.ikspark.mechanisms.forms import FormName
from workcell.ik.mechanisms.goals import FrameGoal
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismResult
from workcell.ik.problem import Budget
from workcell.model.loading.load import compile_spec, load_spec
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.mechanism import Mechanism
from workcell.pose import Pose, axis_angle_to_matrix

BUDGET = Budget(1.0)
PLATFORM = "platform"
LEGS = tuple(f"leg{k}_slide" for k in range(1, 7))
LOWER, UPPER = (0.2, -0.3, 0.8), (0.8, 0.3, 1.05)
"""Metres that the platform's middle is within."""
TURNED = (np.pi / 3, np.pi / 12, np.pi / 12)
"""Most of the angles about z, y and x, either way."""
PAPER_SUCCESS, PAPER_S, PAPER_PROGRAMS = 1.0, 0.2998, 15.83
PAPER_LEGS = (0.073e-6, -0.713e-6, 0.267e-6, -1.048e-6, -1.242e-6, 0.089e-6)
"""Mean differences from the lengths of Dietmaier's legs, metres (Table V)."""
METHODS: tuple[tuple[str, FormName], ...] = (
    *(("ikspark", form) for form in get_args(FormName)),
    ("multistart", "quaternion"),
    ("auto", "quaternion"),
)


@lru_cache(maxsize=2)
def platform_on_legs(cell: str) -> Mechanism:
    """The mechanism of one of the two cells."""
    return mechanism_of(compile_spec(load_spec(cell, kind="cells"), cell), name=cell, where=cell)


def drawn_poses(n: int, seed: int) -> list[Pose]:
    """Poses of the platform's middle, drawn as in the paper."""
    rng, poses = np.random.default_rng(seed), []
    for _ in range(n):
        position, angles = rng.uniform(LOWER, UPPER), rng.uniform(-np.array(TURNED), TURNED)
        z, y, x = (axis_angle_to_matrix(axis, a) for axis, a in zip(np.eye(3)[::-1], angles, strict=True))
        poses.append(Pose.from_rotation(position, z @ y @ x))
    return poses


def postures(n: int) -> list[Pose]:
    """The first n of Dietmaier's postures, of the frame of the site `platform`."""
    T = platform_on_legs("stewart_dietmaier").frame(PLATFORM).T_link_frame
    return [Pose(np.array(position), np.array(quat)) @ T for position, quat in POSTURES[:n]]


def platform_problems(cell: str, poses: Sequence[Pose]) -> list[MechanismProblem]:
    """The questions how the legs hold the platform there."""
    mechanism = platform_on_legs(cell)
    return [
        MechanismProblem(mechanism, (FrameGoal.posed(PLATFORM, pose),), collisions=False, tolerances=TIGHT)
        for pose in poses
    ]


def table5(n: int, seed: int, sets: Path | None = None) -> list[Row]:
    """Every method on n random poses of one platform, and on the (first n of) forty postures of the other."""
    sets_of = {
        "stewart": platform_problems("stewart", drawn_poses(n, seed)),
        "stewart_dietmaier": platform_problems("stewart_dietmaier", postures(n)),
    }
    return [
        _row(cell, problems, solver, form, seed)
        for cell, problems in sets_of.items()
        for solver, form in METHODS
    ]


def _row(cell: str, problems: Sequence[MechanismProblem], solver: str, form: FormName, seed: int) -> Row:
    results = answers(problems, solver, BUDGET, seed, form)
    theirs, random = solver == "ikspark", cell == "stewart"
    extra = {
        "moved_max": worst([v for r in results if (v := counted(r, "moved")) is not None]),
        "leg_errors_mean": None if random else _leg_errors(results, largest=False),
        "leg_errors_max": None if random else _leg_errors(results, largest=True),
        "paper_solve_s": PAPER_S if theirs and random else None,
        "paper_programs": PAPER_PROGRAMS if theirs and random else None,
        "paper_leg_errors_mean": list(PAPER_LEGS) if theirs and not random else None,
    }
    name = f"{cell}/{form if theirs else solver}"
    return mechanism_row(name, results, paper=PAPER_SUCCESS if theirs else None, extra=extra)


def _leg_errors(results: Sequence[MechanismResult], *, largest: bool) -> list[float] | None:
    """For each leg the mean difference from its length, or the largest without its sign, metres."""
    mechanism = platform_on_legs("stewart_dietmaier")
    at = [mechanism.value_slices[mechanism.joint(leg)].start for leg in LEGS]
    found = [result.q[at] - LEG_LENGTHS for result in results if result.q is not None]
    if not found:
        return None
    errors: list[float] = (np.abs(found).max(axis=0) if largest else np.mean(found, axis=0)).tolist()
    return errors


BENCHES = (
    Bench(
        "ikspark-table5",
        100,
        "random poses of a platform on six legs, and the forty postures of another (IKSPARK, section X-B)",
        table5,
    ),
)
