"""The tool of a file that names none: the same for the same robot, whatever order its links stand in."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

from workcell.model.loading.load import load_robot

INERTIA = (
    '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
LINK = '<link name="{name}">' + INERTIA + "{shape}</link>"
SHAPE = "<collision><geometry><sphere radius='0.02'/></geometry></collision>"


def link(name, shape=True):
    return LINK.format(name=name, shape=SHAPE if shape else "")


def joint(name, parent, child, kind="revolute", mimic=""):
    axis = (
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind != "fixed" else ""
    )
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 0 0.1"/>{axis}{mimic}</joint>'
    )


ARM = [link("base"), link("one"), link("two"), joint("j1", "base", "one"), joint("j2", "one", "two")]
HAND = [
    link("hand"),
    joint("mount", "two", "hand", "fixed"),
    link("left"),
    joint("f1", "hand", "left", "prismatic"),
    link("right"),
    joint("f2", "hand", "right", "prismatic", '<mimic joint="f1"/>'),
]
FRAME = [link("grasp", shape=False), joint("tcp", "hand", "grasp", "fixed")]
CAMERA = [link("camera"), joint("eye", "hand", "camera", "fixed")]


def robot(folder, parts):
    file = folder / "robot.urdf"
    file.write_text(f'<robot name="r">{"".join(parts)}</robot>')
    return load_robot(file)


@pytest.mark.parametrize(
    ("extra", "where"), [([], "hand"), (FRAME, "grasp"), (CAMERA + FRAME, "grasp"), (CAMERA, "camera")]
)
def test_a_hand_with_fingers_has_its_tool_where_the_fingers_part(tmp_path, extra, where):
    rng, parts = np.random.default_rng(1), ARM + HAND + extra
    seen = [robot(tmp_path, parts), robot(tmp_path, parts[::-1])]
    seen += [robot(tmp_path, [parts[k] for k in rng.permutation(len(parts))]) for _ in range(6)]
    for found in seen:
        assert found.dof == 2
        q = np.array([0.3, -0.4])
        assert np.allclose(found.fk_transform(q), seen[0].fk_transform(q), atol=1e-12)
    offset = 0.1 * (len(re.findall("tcp|eye", "".join(extra))) > 0) + 0.1
    assert found.tool().T_link_tool.position[2] == pytest.approx(offset), where


def test_a_plain_arm_has_its_tool_at_the_end(tmp_path):
    end = [link("flange"), joint("end", "two", "flange", "fixed")]
    for parts in itertools.permutations(ARM[3:] + end, 3 + 1):
        found = robot(tmp_path, [*ARM[:3], *parts])
        assert found.dof == 2 and found.tool().T_link_tool.position == pytest.approx([0.1, 0.0, 0.1])


def test_two_arms_of_a_torso_are_told_apart_by_name(tmp_path):
    other = [link("uno"), link("zwei"), joint("k1", "base", "uno"), joint("k2", "uno", "zwei")]
    names = {robot(tmp_path, parts).joint_names for parts in (ARM + other, other + ARM, (ARM + other)[::-1])}
    assert names == {("j1", "j2")}
