"""What carries and what is carried: bases on joints of the cell or of another robot, things fixed to a hand."""

import mujoco
import numpy as np
import pytest

from workcell.errors import WorkcellError
from workcell.geometry.pieces import robot_pieces
from workcell.model.collision_model import CollisionModel
from workcell.model.grip import actuated
from workcell.model.scene import Scene
from workcell.motion.teams.team import Team
from workcell.motion.timing.torques import link_inertias
from workcell.pose import Pose
from workcell.world.planning_world import PlanningWorld

ARM = """
<mujoco><compiler angle="radian"/><worldbody><body><geom type="cylinder" size=".06 .05" pos="0 0 .05"/>
 <body pos="0 0 .15"><joint name="j1" axis="0 0 1" range="-3 3"/><geom type="cylinder" size=".04 .02" mass="2"/>
 <body pos="0 0 .05"><joint name="j2" axis="0 1 0" range="-2 2"/>
 <geom type="capsule" fromto="0 0 .08 0 0 .3" size=".03"/>
 <body pos="0 0 .35"><joint name="j3" axis="0 1 0" range="-2.4 2.4"/>
 <geom type="capsule" fromto=".06 0 0 .3 0 0" size=".025"/><site name="tool" pos=".35 0 0"/>
 <site name="flange" pos=".32 0 0" euler="0 1.57 0"/></body></body></body></body></worldbody>
<actuator><motor name="j1" joint="j1"/><motor name="j2" joint="j2"/><motor name="j3" joint="j3"/></actuator></mujoco>
"""
SMALL = """
<mujoco><compiler angle="radian"/><worldbody><body><geom type="cylinder" size=".02 .02" mass=".1"/>
 <body pos="0 0 .04"><joint name="w" axis="1 0 0" range="-1.5 1.5"/>
 <geom type="capsule" fromto="0 0 .03 0 0 .1" size=".012" mass=".1"/><site name="tool" pos="0 0 .12"/></body></body>
</worldbody><actuator><motor name="w" joint="w"/></actuator></mujoco>
"""
DRILL = """
<mujoco><worldbody><body><geom type="box" size=".02 .02 .1" pos="0 0 .1" mass=".3"/>
<body pos="0 0 .2"><geom type="box" size=".01 .08 .01" mass=".1"/></body></body></worldbody></mujoco>
"""
CELL = """
<mujoco><compiler angle="radian"/><worldbody><geom name="post" type="cylinder" size=".05 .5" pos=".45 .3 .5"/>
<body name="rail" pos="0 0 .2" euler=".1 0 .2"><body><joint name="slide" type="slide" axis="1 0 0" range="-2 2"/>
<geom type="box" size=".2 .2 .02" pos="0 0 -.05"/>
<body><joint name="turn" axis="0 0 1" range="-3 3" pos=".1 0 0"/><geom type="sphere" size=".02"/>
<site name="mount" pos="0 0 .1"/><site name="table" pos="1.5 0 0"/></body></body></body></worldbody>
<actuator><position name="slide" joint="slide" ctrlrange="-2 2"/><position name="turn" joint="turn" ctrlrange="-3 3"/>
</actuator></mujoco>
"""
TASK = """
format = "workcell-task/1"
cell = "cell.xml"
[[robots]]
name = "arm"
model = "arm.xml"
mount = "mount"
start = [0.3, 0.2, -0.4]
[[robots]]
name = "small"
model = "small.xml"
mount = "arm/flange"
start = [0.7]
[[objects]]
name = "drill"
model = "drill.xml"
place = "small/tool"
fixed = true
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Scene:
    folder = tmp_path_factory.mktemp("carried")
    for name, text in (("arm", ARM), ("small", SMALL), ("drill", DRILL), ("cell", CELL)):
        (folder / f"{name}.xml").write_text(text)
    (folder / "task.toml").write_text(TASK)
    return Scene.load(folder / "task.toml")


def variants(scene: Scene, rng: np.random.Generator, count: int) -> list[Scene]:
    """The scene with its carriage, its turntable and its arms elsewhere."""
    found = []
    for _ in range(count):
        other = actuated(actuated(scene, "slide", rng.uniform()), "turn", rng.uniform())
        for name in scene.robots:
            other = other.with_start(name, scene.robot(name).robot.random_configuration(rng))
        found.append(other)
    return found


def test_bases_stand_where_what_carries_them_stands(scene: Scene) -> None:
    rng = np.random.default_rng(0)
    for one in [scene, *variants(scene, rng, 10)]:
        for name, robot in one.robots.items():
            seen = one.site_pose(f"{name}/tool")
            assert np.allclose(robot.robot.fk(robot.start).matrix, seen.matrix, atol=1e-12)


def test_positions_that_are_given_move_the_base_too(scene: Scene) -> None:
    rng = np.random.default_rng(1)
    for one in variants(scene, rng, 5):
        collision = CollisionModel(scene, "small", qpos=one.initial_qpos())
        q = collision.robot.robot.random_configuration(rng)
        assert np.allclose(
            collision.robot.robot.fk(q).matrix, collision.site_pose("tool", q).matrix, atol=1e-12
        )


def test_what_is_fixed_to_a_hand_moves_with_it_and_stands_in_no_ones_way(scene: Scene) -> None:
    drill, small, arm = scene.object("drill").body_ids, scene.robot("small"), scene.robot("arm")
    assert drill <= small.guest_ids and drill | small.own_ids <= arm.guest_ids
    assert drill <= set(small.link_body_ids[1]) and drill <= set(arm.link_body_ids[3])
    for name in scene.robots:
        world = PlanningWorld.of(scene, name)
        body_of = scene.model.geom_bodyid
        assert not {int(body_of[piece.geom]) for piece in world.obstacles} & drill
        assert {"drill/drill/geom 1 (box)", "drill/drill/body 1/geom 1 (box)"} <= set(world.cover.source)


@pytest.mark.parametrize("name", ["arm", "small"])
def test_plain_contacts_of_mujoco_decide(scene: Scene, name: str) -> None:
    rng, model, seen = np.random.default_rng(2), scene.model, 0
    for one in variants(scene, rng, 12):
        collision = CollisionModel(one, name)
        data = mujoco.MjData(model)
        for q in collision.robot.robot.random_configuration(rng, 10):
            data.qpos[:] = one.initial_qpos()
            data.qpos[collision.robot.qpos_addresses] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)
            mine = set(collision.robot.body_ids)
            deep = [c.dist for c in data.contact if mine & set(model.geom_bodyid[c.geom].tolist())]
            assert (collision.distance(q).distance < 0) == (min(deep, default=1.0) < 0)
            seen += min(deep, default=1.0) < 0
    assert seen > 5


@pytest.mark.parametrize("name", ["arm", "small"])
def test_covers_hold_what_is_carried(scene: Scene, name: str) -> None:
    """Corners of the drill's boxes, placed by MuJoCo, lie in spheres of the link that carries it."""
    rng, model = np.random.default_rng(3), scene.model
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    for one in variants(scene, rng, 4):
        world = PlanningWorld.of(one, name)
        data = mujoco.MjData(model)
        for q in world.robot.robot.random_configuration(rng, 5):
            data.qpos[:] = world.collision.full_qpos(q)
            mujoco.mj_kinematics(model, data)
            centres = world.cover.centres_world(world.robot.robot.link_transforms(q))
            for geom in range(model.ngeom):
                if int(model.geom_bodyid[geom]) in one.object("drill").body_ids:
                    R = data.geom_xmat[geom].reshape(3, 3)
                    corners = data.geom_xpos[geom] + (signs * model.geom_size[geom]) @ R.T
                    away = np.linalg.norm(corners[:, None] - centres, axis=2)
                    assert (away <= world.cover.radius + 1e-9).any(axis=1).all()


def test_pieces_and_loads_are_those_of_the_moved_base(scene: Scene) -> None:
    """In their links' frames, pieces and masses don't depend on where the base stands."""
    other = variants(scene, np.random.default_rng(4), 1)[0].with_start("small", scene.robot("small").start)
    for name in scene.robots:
        before, after = (robot_pieces(one.model, one.robot(name)) for one in (scene, other))
        for one, two in zip(before, after, strict=True):
            assert all(
                np.allclose(a.pose.matrix, b.pose.matrix, atol=1e-9) for a, b in zip(one, two, strict=True)
            )
        loads = [link_inertias(one, one.robot(name)) for one in (scene, other)]
        assert sum(mass for link in loads[0] for mass, _, _ in link) > 0.4
        for a, b in zip(loads[0][1:], loads[1][1:], strict=True):
            assert all(np.allclose(m[1].matrix, n[1].matrix, atol=1e-9) for m, n in zip(a, b, strict=True))


def test_a_carried_robot_is_left_out_by_none(scene: Scene) -> None:
    with pytest.raises(WorkcellError, match="arm carries small"):
        PlanningWorld.of(scene, "arm").without(["small"])
    alone = PlanningWorld.of(scene, "small").without(["arm"])
    own = scene.robot("small").body_ids
    owners = {int(scene.model.geom_bodyid[geom]) for pair in alone.collision.pair_geoms for geom in pair}
    assert owners & own and not owners & scene.robot("arm").own_ids
    with pytest.raises(WorkcellError, match="small stands on arm"):
        Team.of(scene, "drill", {"arm": Pose.identity(), "small": Pose.identity()})


def test_what_is_fixed_to_a_free_object_is_carried_with_it(tmp_path) -> None:
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "box.xml").write_text(
        '<mujoco><worldbody><body name="box"><geom type="box" size=".05 .05 .05"/>'
        '<site name="top" pos="0 0 .05"/></body></worldbody></mujoco>'
    )
    (tmp_path / "lid.xml").write_text(
        '<mujoco><worldbody><body><geom type="box" size=".2 .02 .01"/></body></worldbody></mujoco>'
    )
    (tmp_path / "cell.xml").write_text(
        '<mujoco><worldbody><site name="spot" pos="1 1 0"/></worldbody></mujoco>'
    )
    (tmp_path / "task.toml").write_text(
        'format = "workcell-task/1"\ncell = "cell.xml"\nrobots = [{name = "arm", model = "arm.xml"}]\n'
        'objects = [{name = "box", model = "box.xml", place = "spot"}, '
        '{name = "lid", model = "lid.xml", place = "box/top", fixed = true}]\n'
    )
    scene = Scene.load(tmp_path / "task.toml")
    assert scene.object("lid").body_ids < scene.object("box").body_ids
    collision = CollisionModel(scene, attached=("box", Pose.identity()))
    lid = min(scene.object("lid").body_ids)
    assert any(int(scene.model.geom_bodyid[geom]) == lid for pair in collision.pair_geoms for geom in pair)
