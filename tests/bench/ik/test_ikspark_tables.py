"""The cells of IKSPARK's tables are as stated, and its rows have their columns."""

from __future__ import annotations

import numpy as np
import pytest

from workcell.bench.ik.ikspark_tables.answers import ALONE, Paper, answers, cell_row
from workcell.bench.ik.ikspark_tables.cells import (
    DENSITIES,
    LEAST_CLEARANCE,
    Cell,
    Kind,
    cells,
    spheres_along,
    workcell_cuboids,
    workcell_obstacles,
)
from workcell.bench.ik.ikspark_tables.table6 import KINDS, PAPER, table6
from workcell.geometry.separation import separations
from workcell.ik.judge.verify import verify
from workcell.ik.result import IKResult, Status
from workcell.ik.stages import SolverStage
from workcell.model.loading.load import load_robot

MANY = 20


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("density", DENSITIES)
def test_the_planted_configuration_reaches_the_target_and_the_exact_kernel_finds_it_clear(
    kind: Kind, density: str
) -> None:
    for cell in cells(kind, density, MANY):
        verdict = verify(cell.problem, cell.planted)
        assert verdict.accepted, verdict.reasons
        assert verdict.position_error < 1e-9 and verdict.clearance.distance >= LEAST_CLEARANCE
        assert cell.problem.cover is not None and len(cell.problem.cover) == DENSITIES[density][0]
        assert (cell.problem.cover.link > 0).all() and cell.problem.checker is None


def test_random_cells_have_20_to_30_boxes_along_the_axes_and_no_free_space() -> None:
    counts = set()
    for cell in cells("random", "mid", MANY):
        pieces = cell.problem.obstacles
        counts.add(len(pieces))
        assert 20 <= len(pieces) <= 30 and cell.problem.free_space is None
        assert all(piece.kind == "box" and np.allclose(piece.pose.rotation, np.eye(3)) for piece in pieces)
    assert len(counts) > 3


def test_the_workcell_has_one_set_of_obstacles_and_four_cuboids_that_they_keep_out_of() -> None:
    drawn = cells("workcell", "high", 3)
    for cell in drawn:
        assert [piece.name for piece in cell.problem.obstacles] == [p.name for p in workcell_obstacles()]
    free = workcell_cuboids()
    assert len(free) == 4
    apart = separations(free.lower, free.upper, workcell_obstacles())[0]
    assert apart.min() > 0.0
    # by the corners alone as well: boxes along the axes are apart where an axis tells them apart
    for piece in workcell_obstacles():
        low, high = piece.pose.position - piece.size, piece.pose.position + piece.size
        assert ((free.lower >= high) | (free.upper <= low)).any(axis=1).all()


def test_the_densities_share_targets_and_obstacles_and_a_seed_repeats() -> None:
    low, high, again, other = (
        cells("random", density, 3, seed)
        for density, seed in (("low", 1), ("high", 1), ("low", 1), ("low", 2))
    )
    for a, b, c, d in zip(low, high, again, other, strict=True):
        assert np.array_equal(a.planted, b.planted) and np.array_equal(a.planted, c.planted)
        assert _boxes(a) == _boxes(b) == _boxes(c) != _boxes(d)


def _boxes(cell: Cell) -> list[list[float]]:
    return [[*piece.pose.position, *piece.size] for piece in cell.problem.obstacles]


def test_spheres_stand_in_equal_steps_on_the_lines_between_joints() -> None:
    robot = load_robot("sawyer").chain()
    cover = spheres_along(robot, 200, 0.05)
    centres = cover.centres_world(robot.link_transforms(np.zeros(robot.dof)))
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    assert np.isclose(np.median(steps), steps.max()) and (steps > 0.4 * steps.max()).all()
    ends = [*robot.joint_xyz[2:], robot.tool().T_link_tool.position]
    assert np.isclose(sum(np.linalg.norm(end) for end in ends), 200 * steps.max())
    assert np.linalg.norm(centres[-1] - robot.fk(np.zeros(robot.dof)).position) < steps.max()


def test_rows_sum_up_the_answers_that_the_judge_accepted() -> None:
    free_space = workcell_cuboids()
    solved = IKResult(
        Status.SOLVED,
        "ikspark",
        position_error=1e-7,
        rotation_error=3e-7,
        stats={"cpu_s": 0.05, "ikspark.sdps": 8.0},
        stages=(SolverStage("cuboids grown", 0.02), SolverStage("relaxation", 0.03)),
        free_space=free_space,
        cuboids=np.zeros(10, dtype=np.int64),
    )
    built = {"ikspark.build_cpu_s": 0.04, "ikspark.built": 0.0, "ikspark.sdps": 2.0}
    lost = IKResult(Status.NOT_FOUND, "ikspark", stats={"cpu_s": 0.15, **built}, free_space=free_space)
    row = cell_row("name", [solved, lost], Paper(0.676, 0.9170, 0.98, 7.88))
    assert row["success"] == 0.5 and row["built"] == 0.0 and row["programs"] == 5.0
    assert row["build_ms"] == pytest.approx(30.0) and row["solve_ms"] == pytest.approx(70.0)
    assert row["position_error_m"] == 1e-7 and row["cuboids"] == 4.0 and row["in_cuboids"] == 0.5
    assert row["paper"] == 0.676 and row["paper_built"] == 0.98
    local = cell_row("name", [IKResult(Status.SOLVED, "multistart", stats={"cpu_s": 0.01})])
    assert local["in_cuboids"] is None and local["build_ms"] is None and local["solve_ms"] == 10.0


def test_in_cuboids_alone_every_sphere_of_an_answer_is_in_the_region_that_is_named() -> None:
    for kind in KINDS:
        drawn = cells(kind, "mid", 4)
        for cell, result in zip(drawn, answers(drawn, ALONE, 0), strict=True):
            assert result.solved and result.q is not None and cell.problem.cover is not None
            assert result.free_space is not None and result.cuboids is not None
            centres = cell.problem.cover.centres_world(cell.problem.robot.link_transforms(result.q))
            regions = len(result.free_space)
            for centre, radius, k in zip(centres, cell.problem.cover.radius, result.cuboids, strict=True):
                if k < regions:
                    assert (centre - radius >= result.free_space.lower[k] - 1e-9).all()
                    assert (centre + radius <= result.free_space.upper[k] + 1e-9).all()


def test_in_cuboids_alone_goes_on_after_an_answer_that_no_region_holds() -> None:
    (result,) = answers([cells("random", "mid", 12)[11]], ALONE, 0)
    assert result.solved and result.free_space is not None


def test_answers_are_judged_and_repeat() -> None:
    drawn = cells("random", "low", 2)
    first, second = (answers(drawn, "ikspark+lm", 0) for _ in range(2))
    for cell, one, two in zip(drawn, first, second, strict=True):
        assert one.solved and one.q is not None and two.q is not None
        assert verify(cell.problem, one.q).accepted and np.array_equal(one.q, two.q)


def test_table_6_has_a_row_for_every_published_one() -> None:
    rows = {row["row"]: row for row in table6(1, 0)}
    for (kind, density, method), published in PAPER.items():
        assert rows[f"sawyer/{kind}/{density}/{method}"]["paper"] == published.solved
    assert all(row["n"] == 1 and len(row) == len(rows[next(iter(rows))]) for row in rows.values())
    assert {f"sawyer/{kind}/high/ikspark" for kind in KINDS} <= rows.keys()
