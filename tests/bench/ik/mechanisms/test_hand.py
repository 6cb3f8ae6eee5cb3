"""Cubes and contacts of the hand's bench are as stated; answers touch what they are to touch and nothing else."""

from __future__ import annotations

import json

import numpy as np
import pytest

import workcell.bench.ik.mechanisms.hand as module
from workcell.bench.ik.mechanisms.hand import (
    ASSIGNMENTS,
    FINGERS,
    HALF,
    METHODS,
    contacts,
    cubes,
    grasp,
)


def test_cubes_stand_around_the_cell_s_own_and_repeat() -> None:
    drawn, again = cubes(10, 4), cubes(10, 4)
    assert drawn[0].half == 0.0275 and len({cube.half for cube in drawn}) == 10
    for one, two in zip(drawn, again, strict=True):
        assert HALF[0] <= one.half <= HALF[1] and one.T_world_cube.error_to(two.T_world_cube) == (0.0, 0.0)


def test_every_finger_has_a_contact_on_its_face_and_a_part_of_it_where_it_shares() -> None:
    cube, assignment = cubes(2, 1)[1], ASSIGNMENTS[0]
    problem = grasp(cube, assignment)
    assert len(problem.mechanism.joints) == 24 and len(problem.goals) == len(FINGERS)
    assert len(problem.regions) == 2 * len(FINGERS) + len(assignment.parts)
    assert set(problem.touching) == set(contacts()) and problem.cover is not None
    compiled = problem.mechanism.compiled
    assert compiled is not None
    np.testing.assert_allclose(compiled.model.geom("cube").size, cube.half)
    for k in range(len(assignment.parts) - 1):
        one, two = problem.regions[2 * len(FINGERS) + k], problem.regions[2 * len(FINGERS) + k + 1]
        # the lower end of one part is the upper end of the next
        np.testing.assert_allclose(one.b[1], -two.b[0], atol=1e-12)


def test_grasps_that_are_found_touch_as_asked_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ASSIGNMENTS", ASSIGNMENTS[:1])
    monkeypatch.setattr(module, "METHODS", METHODS[:2])
    rows = {row["row"]: row for row in module.hand(1, 0)}
    assert len(rows) == 2 and json.dumps(list(rows.values()))
    for row in rows.values():
        assert row["errors"] == 0
        if row["success"]:
            assert row["contact_gap_max"] < 1e-5 and row["clearance_min"] >= 0.0
            assert row["region_error_max"] < 1e-6
    assert max(row["success"] for row in rows.values()) == 1.0
