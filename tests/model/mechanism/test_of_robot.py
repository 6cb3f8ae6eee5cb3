"""A robot's mechanism has its links, tools, limits and couplings where the robot has them."""

from dataclasses import replace

import numpy as np
import pytest

from tests.coupled_arms import coupled_arm
from tests.ik.arms import random_arm
from tests.model.mechanism.trees import compiled
from workcell.model.joined import joined_robot
from workcell.model.loading.compiled import robot_from_model
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.of_robot import of_robot, variables_of
from workcell.model.mechanism.placing import missed, place
from workcell.model.scene import robot_scene
from workcell.pose import Pose


def same_links(robot, q):
    mechanism = of_robot(robot)
    placed, T = place(mechanism, robot.joint_values(q)), robot.link_transforms(q)
    np.testing.assert_allclose(placed.R[1:], T[1:, :3, :3], atol=1e-12)
    np.testing.assert_allclose(placed.p[1:], T[1:, :3, 3], atol=1e-12)
    for name in robot.tools:
        frame, tool = mechanism.frame(name), robot.fk(q, name)
        where = placed.point(frame.link, frame.T_link_frame.position)
        np.testing.assert_allclose(where, tool.position, atol=1e-12)
        R = placed.R[frame.link] @ frame.T_link_frame.rotation
        np.testing.assert_allclose(R, tool.rotation, atol=1e-12)
    return mechanism, placed


@pytest.mark.parametrize("seed", range(4))
def test_an_arm_with_slides_on_a_turned_base(seed):
    rng = np.random.default_rng(seed)
    base = Pose.from_xyz(rng.normal(size=3)) @ Pose(np.zeros(3), [0.5, 0.5, -0.5, 0.5])
    robot = replace(random_arm(rng, sliding=True), T_world_base=base)
    mechanism, _ = same_links(robot, robot.random_configuration(rng))
    assert mechanism.compiled is None and not mechanism.followers
    assert [j.lower for j in mechanism.joints] == robot.lower.tolist()
    assert mechanism.home.tolist() == robot.home.tolist()


def test_two_arms_are_a_tree():
    actors = [robot_scene(name).robot() for name in ("ur10", "sawyer")]
    robot = joined_robot(actors)
    same_links(robot, robot.random_configuration(np.random.default_rng(0)))


@pytest.mark.parametrize("seed", range(4))
def test_joints_that_follow_are_followers(seed):
    text, following = coupled_arm(seed, bent=True)
    model = compiled(text)
    robot = robot_from_model(model)
    q = robot.random_configuration(np.random.default_rng(seed))
    mechanism, placed = same_links(robot, q)
    assert {mechanism.joints[f.joint].name for f in mechanism.followers} <= {f"j{k}" for k in range(7)}
    assert len(mechanism.followers) == len(following)
    np.testing.assert_allclose(missed(placed)[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(variables_of(robot, placed.q), q, atol=0)
    for joint, value in zip(mechanism.joints, placed.q, strict=True):
        assert joint.lower - 1e-9 <= value <= joint.upper + 1e-9
    # the same joints as the compiled model's own mechanism, in the same order, and the same places
    other = mechanism_of(model)
    assert [j.name for j in other.joints] == [j.name for j in mechanism.joints]
    np.testing.assert_allclose(place(other, placed.q).p, placed.p, atol=1e-12)
