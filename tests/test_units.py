"""One rule for quaternions at every door: what is nearly a unit is made one, what is not is refused."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import numpy as np
import pytest

from workcell.cli import exit_codes, main
from workcell.errors import WorkcellError
from workcell.model.loading.taskfile import read_task_file
from workcell.pose import UNIT_TOLERANCE, Pose
from workcell.sets.problems import parse_problem_set

SET = json.loads((Path(__file__).parent / "sets" / "files" / "seven_random.json").read_text())
WITHIN, BEYOND = (1 - 0.99 * UNIT_TOLERANCE, 1 + 0.99 * UNIT_TOLERANCE), (1 - 2 * UNIT_TOLERANCE, 1.1)


def by_pose(length):
    return Pose(np.zeros(3), length * np.array([0.6, 0.0, 0.8, 0.0])).rotation


def by_target(length):
    document = copy.deepcopy(SET)
    document["problems"][0]["target"]["quat"] = [0.6 * length, 0.0, 0.8 * length, 0.0]
    return parse_problem_set(document).problems[0].problem.target.rotation


def by_joint(length):
    document = copy.deepcopy(SET)
    document["robot"]["joints"][2]["quat"] = [0.6 * length, 0.0, 0.8 * length, 0.0]
    return parse_problem_set(document).robot.joint_rotation[2]


def by_task(length, folder):
    file = folder / "task.toml"
    quat = [0.6 * length, 0.0, 0.8 * length, 0.0]
    file.write_text(
        'format = "workcell-task/1"\nname = "task"\ncell = "cell.xml"\n'
        '[[robots]]\nname = "arm"\nmodel = "sawyer"\nmount = "m"\n'
        f'[[goals]]\nname = "goal"\nrobot = "arm"\nxyz = [0.5, 0, 0.5]\nquat_wxyz = {quat}\n'
    )
    return read_task_file(file).goals[0].offset.rotation


def doors(folder):
    return (by_pose, by_target, by_joint, lambda length: by_task(length, folder))


def test_what_is_nearly_a_unit_is_made_one_everywhere(tmp_path):
    for door in doors(tmp_path):
        for length in WITHIN:
            assert np.allclose(door(length), by_pose(1.0), atol=1e-12), door


def test_what_is_none_is_refused_everywhere(tmp_path):
    for door in doors(tmp_path):
        for length in BEYOND:
            with pytest.raises(WorkcellError, match="unit"):
                door(length)


def test_the_command_line_has_the_same_rule(capsys):
    for lengths, refused in ((WITHIN, False), (BEYOND, True)):
        for length in lengths:
            pose = [f"{value * length:.12g}" for value in (0.6, 0.0, 0.8, 0.0)]
            with pytest.raises(SystemExit) as stop:
                main(["ik", "ur10", "--pose", "0.4", "0.2", "0.5", *pose, "--budget-s", "1"])
            assert (stop.value.code == exit_codes.BAD_INPUT) is refused
            capsys.readouterr()
