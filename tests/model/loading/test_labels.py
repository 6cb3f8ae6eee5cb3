"""What a file leaves without a name gets a label; what it names keeps its name; nothing is told apart by labels."""

import re

import mujoco
import numpy as np
import pytest

from workcell.errors import ModelError
from workcell.model.collision_model import CollisionModel
from workcell.model.labels import obstacle_label
from workcell.model.loading.labels import KINDS, keep_apart, label
from workcell.model.loading.load import load_compiled
from workcell.model.scene import Scene

NAMED = """
<mujoco><compiler angle="radian"/><worldbody>
  <geom name="floor" type="plane" size="2 2 .1" pos="0 0 -.3"/>
  <body name="base"><geom name="foot" type="cylinder" size=".06 .05" pos="0 0 .05"/>
    <frame name="f" pos="0 0 .15" euler="0 0 .2">
    <body name="a"><joint name="j1" axis="0 0 1" range="-3 3"/><geom name="hub" type="cylinder" size=".04 .02"/>
      <body name="b" pos="0 0 .05"><joint name="j2" axis="0 1 0" range="-2 2"/>
        <joint name="j3" type="slide" axis="0 0 1" range="0 .1"/>
        <geom name="upper" type="capsule" fromto="0 0 .08 0 0 .3" size=".03"/>
        <body name="c" pos="0 0 .35"><joint name="j4" axis="0 1 0" range="-2.4 2.4"/>
          <geom name="fore" type="capsule" fromto=".06 0 0 .3 0 0" size=".025"/>
          <site name="tool" pos=".35 0 0"/>
          <body name="bracket" pos=".3 0 0"><geom name="blade" type="box" size=".03 .15 .01"/></body>
        </body>
      </body>
    </body></frame>
  </body>
</worldbody>
<actuator><motor name="m1" joint="j1"/><motor name="m2" joint="j2"/><motor name="m3" joint="j3"/>
<motor name="m4" joint="j4"/></actuator></mujoco>
"""
CELL = """
<mujoco><worldbody><site name="robot_mount" pos=".1 -.2 .4" euler="0 0 .3"/>
  <body name="{near}" pos=".5 0 .5"><geom type="box" size=".05 .3 .3"/></body>
  <geom name="post" type="cylinder" size=".05 .5" pos="0 .6 .4"/>
</worldbody></mujoco>
"""


def without_names(
    rng: np.random.Generator, text: str, kept: tuple[str, ...] = ("tool",), share: float = 0.5
) -> str:
    """The same model, some names of bodies, geoms and actuators gone; joints keep theirs, which actuators name."""

    def dropped(match: re.Match[str]) -> str:
        element, name = match.group(1), match.group(2)
        keep = element in ("joint", "site") or name in kept or rng.random() > share
        return match.group(0) if keep else f"<{element}"

    return re.sub(r'<(body|geom|site|joint|motor) name="([^"]*)"', dropped, text)


def names_of(spec: mujoco.MjSpec) -> dict[str, list[str]]:
    return {kind: [one.name for one in getattr(spec, several)] for kind, several in KINDS.items()}


def test_every_element_has_a_name_of_its_own_and_given_names_stay() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        text = without_names(rng, NAMED)
        spec = mujoco.MjSpec.from_string(text)
        before = names_of(spec)
        label(spec)
        for kind, names in names_of(spec).items():
            assert all(names) and len(set(names)) == len(names), kind
            assert [new for new, old in zip(names, before[kind], strict=True) if old] == list(
                filter(None, before[kind])
            )
        spec.compile()


def test_labels_say_where_and_what() -> None:
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><geom size=".1"/><body name="l3"><joint/><geom name="x" size=".1"/>'
        '<geom type="box" size=".1 .1 .1"/><site/><body><freejoint/><geom size=".1"/><body><geom size=".1"/></body>'
        "</body></body></worldbody></mujoco>".replace("<freejoint/>", "<joint/>")
    )
    label(spec)
    names = names_of(spec)
    assert names["body"] == ["world", "l3", "l3/body 1", "l3/body 2"]
    assert names["geom"] == [
        "world/geom 1 (sphere)",
        "x",
        "l3/geom 2 (box)",
        "l3/body 1/geom 1 (sphere)",
        "l3/body 2/geom 1 (sphere)",
    ]
    assert names["joint"] == ["joint 1 of l3", "joint 1 of l3/body 1"]
    assert names["site"] == ["l3/site 1"]


def test_a_name_that_looks_like_a_label_stays_and_the_label_gives_way() -> None:
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body name="l3"><geom name="l3/geom 2 (box)" size=".1"/><geom type="box" size=".1 .1 .1"/>'
        '</body><body name="body 1"/><body/></worldbody></mujoco>'
    )
    label(spec)
    assert names_of(spec)["geom"] == ["l3/geom 2 (box)", "l3/geom 2 (box) ~2"]
    assert names_of(spec)["body"] == ["world", "l3", "body 1", "body 1 ~2"]


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_robot_is_the_same_with_and_without_names(tmp_path, share: float) -> None:
    """Joints, limits, kinematics, links and distances: names are for people alone."""
    rng, path = np.random.default_rng(1), tmp_path / "arm.xml"
    (tmp_path / "cell.xml").write_text(CELL.format(near="near"))

    def loaded(text: str):  # type: ignore[no-untyped-def]
        path.write_text(text)
        scene = Scene.load(tmp_path / "cell.xml", robot=str(path))
        return load_compiled(path)[1], scene, CollisionModel(scene)

    robot, scene, collision = loaded(NAMED)
    q = robot.random_configuration(rng, 40)
    for _ in range(4):
        other, bare, distances = loaded(without_names(rng, NAMED, share=share))
        assert other.joint_names == robot.joint_names == ("j1", "j2", "j3", "j4")
        assert np.array_equal(other.fk_transform(q), robot.fk_transform(q))
        assert bare.robot().link_body_ids == scene.robot().link_body_ids
        assert bare.robot().link_body_ids[3] == (4,) and bare.robot().link_body_ids[2] == ()
        for one in q:
            assert distances.distance(one).distance == collision.distance(one).distance


def test_plain_contacts_of_mujoco_decide(tmp_path) -> None:
    """Contacts of a nameless robot, found by MuJoCo with enlarged margins, are ours, and the other way round."""
    (tmp_path / "arm.xml").write_text(without_names(np.random.default_rng(2), NAMED, share=1.0))
    (tmp_path / "cell.xml").write_text(CELL.format(near="arm/near"))
    scene = Scene.load(tmp_path / "cell.xml", robot=str(tmp_path / "arm.xml"))
    arm, collision, model = scene.robot(), CollisionModel(scene), scene.model
    model.geom_margin[:] = 0.05
    data, seen = mujoco.MjData(model), 0
    for q in arm.robot.random_configuration(np.random.default_rng(3), 60):
        data.qpos[:] = collision.full_qpos(q)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        mine = [c.dist for c in data.contact if set(model.geom_bodyid[c.geom].tolist()) & arm.body_ids]
        found = collision.distance(q).distance
        if mine and min(mine) > 0:  # depths differ between the two, signs don't
            assert found == pytest.approx(min(mine), abs=1e-5)
        assert (found < 0) == (min(mine, default=1.0) < 0)
        seen += min(mine, default=1.0) < 0
    assert 0 < seen < 60


def test_a_body_and_a_geom_of_one_name_are_two_obstacles(tmp_path) -> None:
    (tmp_path / "arm.xml").write_text(NAMED)
    (tmp_path / "cell.xml").write_text(CELL.format(near="post"))
    model = Scene.load(tmp_path / "cell.xml", robot=str(tmp_path / "arm.xml")).model
    names = {obstacle_label(model, geom) for geom in range(model.ngeom) if model.geom_bodyid[geom] < 2}
    assert {"post", "post (geom)"} <= names


def test_a_cell_body_that_looks_like_the_robots_is_not_the_robots(tmp_path) -> None:
    (tmp_path / "arm.xml").write_text(NAMED)
    (tmp_path / "cell.xml").write_text(CELL.format(near="arm/near"))
    scene = Scene.load(tmp_path / "cell.xml", robot=str(tmp_path / "arm.xml"))
    assert "arm/near" in scene.obstacles
    assert scene.model.body("arm/near").id not in scene.robot().body_ids


def test_a_name_that_is_taken_is_refused_and_a_label_gives_way(tmp_path) -> None:
    (tmp_path / "arm.xml").write_text(NAMED)
    (tmp_path / "cell.xml").write_text(CELL.format(near="arm/base"))
    with pytest.raises(ModelError, match="there is a body 'arm/base' already"):
        Scene.load(tmp_path / "cell.xml", robot=str(tmp_path / "arm.xml"))
    parent, child = (
        mujoco.MjSpec.from_string(text)
        for text in (
            '<mujoco><worldbody><body name="r"><body/></body><site name="m"/></worldbody></mujoco>',
            "<mujoco><worldbody><body/></worldbody></mujoco>",
        )
    )
    label(parent)
    label(child)
    keep_apart(parent, child, "r/", "here")
    parent.attach(child, site=parent.site("m"), prefix="r/")
    parent.compile()
    assert [body.name for body in parent.bodies] == ["world", "r", "r/body 1", "r/body 1 ~2"]


TASK = """
format = "workcell-task/1"
cell = "cell.xml"
[[robots]]
name = "arm"
model = "arm.xml"
mount = "robot_mount"
[[robots]]
name = "arm.b"
model = "arm.xml"
mount = "two"
[[objects]]
name = "mug"
model = "mug.xml"
place = "spot"
[[objects]]
name = "mug.b"
model = "mug.xml"
place = "spot2"
"""
MUG = """
<mujoco><worldbody><body><geom size=".04"/><body pos=".06 0 0"><geom size=".02"/></body></body></worldbody></mujoco>
"""
SITES = '<site name="two" pos="2 0 0"/><site name="spot" pos="3 0 0"/><site name="spot2" pos="4 0 0"/></worldbody>'


def test_names_that_begin_alike_are_told_apart_and_handles_are_carried(tmp_path) -> None:
    (tmp_path / "arm.xml").write_text(NAMED)
    (tmp_path / "mug.xml").write_text(MUG)
    cell = CELL.format(near="arm.b/near").replace(
        "</worldbody>",
        '<site name="two" pos="2 0 0"/><site name="spot" pos="3 0 0"/><site name="spot2" pos="4 0 0"/></worldbody>',
    )
    (tmp_path / "cell.xml").write_text(cell)
    (tmp_path / "task.toml").write_text(TASK.replace("{{", "{").replace("}}", "}"))
    scene = Scene.load(tmp_path / "task.toml")
    groups = [
        *(robot.body_ids for robot in scene.robots.values()),
        *(thing.body_ids for thing in scene.objects.values()),
    ]
    assert [len(group) for group in groups] == [5, 5, 2, 2]
    assert len(frozenset().union(*groups)) == 14
    assert scene.model.body(scene.object("mug").body_id).name == "mug/mug"
    assert "arm.b/near" in scene.obstacles
