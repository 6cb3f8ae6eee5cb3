"""Arms of the bench are special but for little, and its tables count what they say."""

import numpy as np

from workcell.bench.ik.nearly import nearly_rows, solution_rows
from workcell.bench.reference.nearly import WRITTEN, nearly_arm, written_arm


def test_arms_are_special_but_for_little() -> None:
    for seed in range(20):
        arm = nearly_arm(np.random.default_rng(seed), 1e-9, 1e-6)
        axes = np.einsum("kij,kj->ki", arm.link_transforms(np.zeros(arm.dof))[1:, :3, :3], arm.axis)
        cosines = np.abs(axes @ axes.T)
        # but for a quaternion that is written in four digits
        assert np.minimum(cosines, np.abs(1.0 - cosines)).max() < 1e-3
        whole = written_arm(np.random.default_rng(seed), digits=len(WRITTEN[np.pi]) - 1)
        assert whole.dof in (6, 7)


def test_tables_count_wrong_noes_and_boxes() -> None:
    rows = nearly_rows(1, seed=3)
    assert {row["row"].split("/")[0] for row in rows} == {"nearly", "written"}
    assert all(row["false_no"] == 0 for row in rows)
    boxes = solution_rows(60, seed=0)
    assert sum(row["n"] for row in boxes) == 60
    assert all(row["certified"] == 1.0 for row in boxes)
