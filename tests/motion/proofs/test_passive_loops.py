"""Paths of arms with passive loops: what is proved is clear with the rods where plain MuJoCo has them."""

import numpy as np
import pytest

from tests.model.loops.linkages import demanded, four_bar, nearest, parallel_arm
from workcell.ik.solve import solve
from workcell.model.scene import Scene
from workcell.motion.path import Path
from workcell.motion.plans.in_scene import plan_in_world
from workcell.motion.proofs.on_model import prove_path
from workcell.world.planning_world import PlanningWorld

JOINED = (("rod", "bracket"), ("coupler", "rocker"))


def posts(rng, count):
    places = rng.uniform([-0.4, -0.15, -0.1], [0.4, 0.2, 0.6], (count, 3))
    return "".join(
        f'<geom name="post{k}" type="{rng.choice(["box", "sphere", "cylinder"])}" size=".02 .03 .03" '
        f'pos="{x} {y} {z}"/>'
        for k, (x, y, z) in enumerate(places)
    )


@pytest.mark.parametrize("seed", range(5))
def test_no_line_is_proved_through_a_post(tmp_path, seed):
    rng = np.random.default_rng(seed)
    text = parallel_arm(rng, posts(rng, 5)) if seed % 3 else four_bar(rng)
    (tmp_path / "cell.xml").write_text(text)
    world = PlanningWorld.of(Scene.load(tmp_path / "cell.xml"))
    robot, model, proved = world.robot.robot, world.scene.model, 0
    for _ in range(10):
        path = Path(robot, robot.random_configuration(rng, 2))
        proof = prove_path(path, world.clearance, world.cover)
        seen = [world.collision.full_qpos(path.at(t)) for t in np.linspace(0, 1, 40)]
        if not proof.proved:
            continue
        proved += 1
        for qpos in seen:
            assert demanded(model, qpos) < 1e-6
            assert nearest(model, qpos, JOINED) > -1e-6
    assert proved or seed % 3 == 0


def test_rods_count_for_answers_and_plans(tmp_path):
    """A post stands where only the rod goes: the arm is free of it, and the answer is not."""
    rng = np.random.default_rng(11)
    plain = tmp_path / "plain.xml"
    plain.write_text(parallel_arm(rng))
    world = PlanningWorld.of(Scene.load(plain))
    q = np.array([-0.5, 0.4])
    model, qpos = world.scene.model, world.collision.full_qpos(q)
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    post = " ".join(map(str, data.geom("rod").xpos))
    place = '<geom name="post" type="sphere" size=".012" pos="{}"/>'
    cell = tmp_path / "cell.xml"
    cell.write_text(parallel_arm(np.random.default_rng(11), place.format(post)))
    blocked = PlanningWorld.of(Scene.load(cell))
    assert solve(world.problem(world.tool_pose(q)), seed=0).solved
    answer = solve(blocked.problem(blocked.tool_pose(q)), seed=0)
    assert not answer.solved
    found = blocked.clearance(q)
    assert set(found.pair) == {"rod", "post"} and found.distance < -0.01
    start, goal = np.array([0.9, 0.2]), np.array([-1.0, 0.2])
    planned = plan_in_world(world, start, goal)
    assert planned.planned
    around = plan_in_world(blocked, start, goal)
    if around.planned:
        for t in np.linspace(0, len(around.path) - 1, 200):
            there = blocked.collision.full_qpos(around.path.at(t))
            assert nearest(blocked.scene.model, there, JOINED) > -1e-6
