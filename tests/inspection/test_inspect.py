"""`workcell check`: every kind of line that it can say, each on a small model that gives rise to it."""

from __future__ import annotations

import json

import mujoco
import numpy as np
import pytest

from workcell.cli import exit_codes, main
from workcell.errors import ModelError
from workcell.inspection.inspect import inspect_scene
from workcell.inspection.mechanisms import mechanism_findings
from workcell.inspection.meshes import enclosed_volume, hull_volume
from workcell.model.collision_model import CollisionModel
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.scene import Scene, robot_scene

SECOND = 'name="g1" type="capsule" fromto="0 0 0.06 0 0 0.16" size="0.03"'
TIP = '<site name="tool" pos="0 0 0.2"/>'


def chain(count=2, *, shape="0.03", tip=TIP, prefix="", extra="", joint=""):
    """Links on top of each other, with a capsule each, that turn about y."""
    inside = tip
    for k in reversed(range(count)):
        geom = (
            f'<geom name="{prefix}g{k}" type="capsule" fromto="0 0 0.06 0 0 0.16" size="{shape}"/>'
            if shape
            else ""
        )
        inside = (
            f'<body name="{prefix}l{k}" pos="0 0 0.2"><joint name="{prefix}j{k}" axis="0 1 0" range="-1 1" {joint}/>'
            f"{geom}{inside}</body>"
        )
    return f'<body name="{prefix}base">{extra}{inside}</body>'


def motors(count=2, prefix="", kind='<motor joint="{}"/>'):
    return "".join(kind.format(f"{prefix}j{k}") for k in range(count))


def model(body=None, *, actuators=None, top="", world="", bottom=""):
    body, actuators = chain() if body is None else body, motors() if actuators is None else actuators
    return (
        f'<mujoco><compiler angle="radian"/>{top}<worldbody>{body}{world}</worldbody>'
        f"<actuator>{actuators}</actuator>{bottom}</mujoco>"
    )


@pytest.fixture
def inspected(tmp_path):
    def run(text, name="robot.xml"):
        (tmp_path / name).write_text(text)
        return inspect_scene(Scene.load(tmp_path / name))

    return run


def lines(findings, about, level=None):
    return [f for f in findings if f.about == about and level in (None, f.level)]


def test_a_plain_arm_has_nothing_to_beware_of(inspected):
    findings = inspected(model())
    assert {f.level for f in findings} == {"fact"}
    joints = {f.data["joint"]: f.data for f in lines(findings, "joint")}
    assert joints["j0"]["kind"] == "driven" and joints["j0"]["lower"] == -1.0
    assert joints["j0"]["limits_from"] == "the file's"
    assert [f.data["tool"] for f in lines(findings, "tool")] == ["tool"]


def test_every_joint_is_named_with_who_moves_it(inspected):
    geom = '<geom size="0.01" pos="0 0.3 0" contype="0" conaffinity="0"/>'
    extra = f'<body name="flap"><joint name="flap" axis="1 0 0"/>{geom}</body>'
    coupled = '<equality><joint joint1="j1" joint2="j0" polycoef="0.1 0.5 0 0 0"/></equality>'
    drives = '<motor joint="j0"/><motor joint="j2"/>'
    findings = inspected(model(chain(3, extra=extra), actuators=drives, bottom=coupled))
    joints = {f.data["joint"]: f for f in lines(findings, "joint")}
    assert {name: f.data["kind"] for name, f in joints.items()} == {
        "j0": "driven", "j1": "coupled", "j2": "driven", "flap": "passive",
    }  # fmt: skip
    assert joints["j1"].data["follows"] == "j0" and joints["j1"].data["coefficients"][:2] == [0.1, 0.5]
    assert "0.1 + 0.5 q" in joints["j1"].text and "passive" in joints["flap"].text


def test_locked_joints_and_joints_without_limits_say_so(inspected):
    body = chain(3).replace('name="j1" axis="0 1 0" range="-1 1"', 'name="j1" axis="0 1 0" range="0.5 0.5"')
    body = body.replace('name="j2" axis="0 1 0" range="-1 1"', 'name="j2" axis="0 1 0"')
    findings = inspected(model(body, actuators=motors(3)))
    joints = {f.data["joint"]: f for f in lines(findings, "joint")}
    assert joints["j1"].data["kind"] == "locked" and "locked at 0.5" in joints["j1"].text
    assert "the file has no limits" in joints["j2"].text


def test_loops_are_named(inspected):
    world = '<body name="bob" pos="0.5 0 0"><joint name="s" axis="0 1 0"/><geom size="0.01"/></body>'
    loop = '<equality><connect body1="bob" body2="base" anchor="0 0 0"/></equality>'
    findings = inspected(model(world=world, bottom=loop))
    (found,) = lines(findings, "loop")
    assert found.data["kind"] == "connect" and {"bob", "base"} == set(found.data["bodies"])
    (stray,) = lines(findings, "body")
    assert stray.level == "beware" and stray.data["bodies"] == ["bob"]


def test_two_arms_of_one_file_are_both_offered(inspected, tmp_path):
    left = chain(2, prefix="left_", tip='<site name="left_tool"/>')
    right = chain(2, prefix="right_", tip='<site name="right_tool"/>').replace(
        "<body", '<body pos="0 1 0"', 1
    )
    body = f'<body name="torso"><geom size="0.02"/>{left}{right}</body>'
    text = model(body, actuators=motors(2, "left_") + motors(2, "right_"))
    findings = inspected(text)
    offered = [f for f in lines(findings, "tool") if "could_be" in f.data]
    assert [f.data["could_be"] for f in offered] == ["right_tool"]
    assert offered[0].data["joints"] == ["right_j0", "right_j1"] and 'tool = "right_tool"' in offered[0].text
    # and the way to choose it is one
    (tmp_path / "cell.xml").write_text('<mujoco><worldbody><site name="m"/></worldbody></mujoco>')
    (tmp_path / "task.toml").write_text(
        'format = "workcell-task/1"\nname = "t"\ncell = "cell.xml"\n'
        '[[robots]]\nname = "arm"\nmodel = "robot.xml"\nmount = "m"\ntool = "right_tool"\n'
    )
    assert Scene.load(tmp_path / "task.toml").robot().robot.joint_names == ("right_j0", "right_j1")


def test_missing_geometry_is_wrong(inspected):
    seen_only = chain(2).replace("<geom ", '<geom contype="0" conaffinity="0" ')
    (found,) = lines(inspected(model(seen_only)), "geometry")
    assert found.level == "wrong" and "no geometry" in found.text
    bare = chain(2).replace('name="g1"', 'name="g1" contype="0" conaffinity="0"')
    (found,) = lines(inspected(model(bare)), "geometry")
    assert found.level == "beware" and found.data["links"] == ["l1"]


def overlapping():
    """The base's ball and that of the second link always overlap; the link between has nothing that collides."""
    body = chain(2, extra='<geom name="ball" size="0.25"/>').replace(
        'name="g0"', 'contype="0" conaffinity="0"'
    )
    return body.replace(SECOND, 'name="g1" size="0.2"')


def test_pairs_that_always_touch_are_wrong_with_a_remedy_that_helps(inspected, tmp_path):
    (found,) = lines(inspected(model(overlapping())), "touching")
    assert found.level == "wrong" and found.data["share"] == 1.0 and "robot.xml" in found.text
    remedy = found.text[found.text.index("<contact>") :]
    mended = inspected(model(overlapping(), bottom=remedy))
    assert not lines(mended, "touching")


URDF = """<robot name="r">
<link name="base"><collision><geometry><sphere radius="0.25"/></geometry></collision></link>
<link name="one"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="two"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><sphere radius="0.2"/></geometry></collision></link>
<joint name="a" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0 0 0.2"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_what_a_urdf_can_t_hold_the_cell_can(inspected, tmp_path):
    (found,) = lines(inspected(URDF, "robot.urdf"), "touching")
    assert "a URDF can't hold an exclusion" in found.text and 'body1="NAME/' in found.text
    start = found.text.index("<contact>")
    remedy = found.text[start : found.text.index("</contact>") + len("</contact>")].replace("NAME/", "arm/")
    (tmp_path / "cell.xml").write_text(f'<mujoco><worldbody><site name="m"/></worldbody>{remedy}</mujoco>')
    (tmp_path / "task.toml").write_text(
        'format = "workcell-task/1"\nname = "t"\ncell = "cell.xml"\n'
        '[[robots]]\nname = "arm"\nmodel = "robot.urdf"\nmount = "m"\n'
    )
    scene = Scene.load(tmp_path / "task.toml")
    assert CollisionModel(scene, "arm").distance(scene.robot().start).distance > 0
    assert not lines(inspect_scene(scene), "touching")


def test_pairs_that_mostly_touch_are_told(inspected):
    body = overlapping().replace('name="ball" size="0.25"', 'name="ball" size="0.06"')
    body = body.replace('name="g1" size="0.2"', 'name="g1" size="0.3"')
    findings = lines(inspected(model(body.replace('range="-1 1"', 'range="-2.5 2.5"'))), "touching")
    for found in findings:
        assert 0.5 <= found.data["share"] <= 1.0 and (found.level == "wrong") is (found.data["share"] == 1.0)


CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float) * 0.1
FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


def l_shape():
    """Two cubes and a third on one of them, as triangles without the walls between: a hull adds a sixth."""
    outline = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], dtype=float) * 0.1
    low, high = (np.column_stack([outline, np.full(6, z)]) for z in (0.0, 0.1))
    caps = [[0, 1, 3], [1, 2, 3], [0, 3, 5], [3, 4, 5]]
    faces = [[c, b, a] for a, b, c in caps] + [[a + 6, b + 6, c + 6] for a, b, c in caps]
    for k in range(6):
        n = (k + 1) % 6
        faces += [[k, n, n + 6], [k, n + 6, k + 6]]
    return np.vstack([low, high]), np.array(faces)


def mesh_model(vertices, faces, scale=1.0, inertia="convex"):
    listed = " ".join(f"{v:g}" for v in (scale * vertices).ravel())
    triangles = " ".join(str(int(i)) for i in faces.ravel())
    asset = f'<asset><mesh name="part" inertia="{inertia}" vertex="{listed}" face="{triangles}"/></asset>'
    body = chain(2).replace(SECOND, 'type="mesh" mesh="part"')
    return model(body, top=asset)


def test_volumes_of_meshes_are_those_of_their_solids():
    assert enclosed_volume(CUBE, FACES) == pytest.approx(1e-3) or enclosed_volume(
        CUBE, FACES
    ) == pytest.approx(-1e-3)
    vertices, faces = l_shape()
    assert abs(enclosed_volume(vertices, faces)) == pytest.approx(3e-3)
    assert hull_volume(vertices) == pytest.approx(3.5e-3)
    assert hull_volume(vertices[:6]) == 0.0


def test_concave_meshes_say_what_their_hull_adds(inspected):
    (found,) = lines(inspected(mesh_model(*l_shape())), "mesh")
    assert found.level == "beware" and found.data["hull_adds"] == pytest.approx(1 / 6, rel=1e-3)
    assert "concave" in found.text and "17 %" in found.text
    outward = FACES if enclosed_volume(CUBE, FACES) > 0 else FACES[:, ::-1]
    assert not lines(inspected(mesh_model(CUBE, outward)), "mesh")


def test_meshes_inside_out_are_told(inspected):
    inward = FACES if enclosed_volume(CUBE, FACES) < 0 else FACES[:, ::-1]
    (found,) = lines(inspected(mesh_model(CUBE, inward)), "mesh")
    assert found.level == "beware" and "inside out" in found.text


def test_meshes_in_millimetres_are_wrong(inspected):
    outward = FACES if enclosed_volume(CUBE, FACES) > 0 else FACES[:, ::-1]
    found = lines(inspected(mesh_model(CUBE, outward, scale=1000.0)), "mesh", "wrong")
    assert (
        len(found) == 1 and "millimetres" in found[0].text and found[0].data["across_m"] == pytest.approx(100)
    )


@pytest.mark.parametrize(
    ("option", "name", "words"),
    [
        ('<option gravity="0 0 0"/>', "gravity", "torques"),
        ('<option density="1.2"/>', "density", "torques"),
        ('<option ccd_iterations="3"/>', "ccd_iterations", "judged without it"),
        ('<option><flag gravity="disable"/></option>', "gravity", "disabled"),
        ('<option><flag filterparent="disable"/></option>', "filterparent", "carry them"),
        ('<option><flag nativeccd="disable"/></option>', "nativeccd", "judged without it"),
    ],
)
def test_options_that_change_something_are_told(inspected, option, name, words):
    found = [f for f in lines(inspected(model(top=option)), "option") if f.data["option"] == name]
    assert len(found) == 1 and found[0].level == "beware" and words in found[0].text


def test_actuators_that_can_t_be_driven_are_wrong(inspected):
    slow = motors(kind='<position joint="{}" kp="10" timeconst="0.1"/>')
    found = lines(inspected(model(actuators=slow)), "actuator")
    assert len(found) == 2 and found[0].level == "wrong" and "state of its own" in found[0].text
    assert not lines(
        inspected(model(actuators=motors(kind='<position joint="{}" kp="10" kv="1"/>'))), "actuator"
    )


def test_the_command_says_all_of_it_and_json_has_it_for_programs(tmp_path, capsys):
    file = tmp_path / "robot.xml"
    file.write_text(model(overlapping(), top='<option gravity="0 0 -1.6"/>'))
    for arguments in ((), ("--json",)):
        with pytest.raises(SystemExit) as stop:
            main(["check", str(file), *arguments])
        assert stop.value.code == exit_codes.BAD_INPUT
        out = capsys.readouterr().out
        if arguments:
            found = json.loads(out)
            levels = {f["level"] for f in found["findings"]}
            assert levels == {"fact", "beware", "wrong"} and found["problems"] and found["beware"]
        else:
            assert "BEWARE" in out and "WRONG" in out and "touch in every configuration" in out


@pytest.mark.parametrize("name", ["sawyer", "ur10", "iiwa14"])
def test_our_own_robots_have_nothing_wrong(name):
    assert not [f.text for f in inspect_scene(robot_scene(name)) if f.level == "wrong"]


def platform(anchor="0 0 .3", more="", drive='<motor joint="lift"/>'):
    """A floating plate on a driven post and a passive one that swings on a ball joint."""
    return f"""<mujoco><compiler angle="radian"/><worldbody>
      <body name="post"><joint name="lift" type="slide" axis="0 0 1" range="0 1"/><geom name="post" size=".02"/></body>
      <body name="leg" pos=".4 0 0"><joint name="swing" type="ball"/><geom name="leg" size=".02"/></body>
      <body name="plate" pos="0 0 .3"><freejoint name="plate"/><geom name="plate" size=".02"/></body></worldbody>
      <equality><weld name="w" body1="post" body2="plate" relpose="0 0 .3 1 0 0 0"/>{more}</equality>
      <actuator>{drive}</actuator></mujoco>"""


def as_mechanism(text):
    try:
        found = mechanism_of(mujoco.MjModel.from_xml_string(text))
    except ModelError as error:
        return list(mechanism_findings(error, serial=False))
    return list(mechanism_findings(found, serial=False))


def test_mechanisms_say_who_drives_them_and_what_their_ties_leave():
    findings = as_mechanism(platform())
    assert not [f for f in findings if f.level != "fact"]
    (summary, freedom) = lines(findings, "mechanism")
    assert summary.data["kinds"] == {"hinge": 0, "slide": 1, "ball": 1, "free": 1}
    assert (summary.data["driven"], summary.data["following"], summary.data["passive"]) == (1, 0, 2)
    assert (freedom.data["dof"], freedom.data["left"], freedom.data["rank"]) == (10, 4, 6)
    joints = {f.data["joint"]: f.data["kind"] for f in lines(findings, "joint")}
    assert joints == {"swing": "ball", "plate": "floating"}
    assert [f for f in lines(findings, "tie") if f.data.get("missed", 1.0) < 1e-9]


def test_ties_that_say_nothing_new_or_are_open_at_the_start_are_told():
    again = '<connect name="c" body1="post" body2="plate" anchor="0 .1 .3"/>'
    (found,) = lines(as_mechanism(platform(more=again)), "tie", "beware")
    assert "say nothing that other ties don't say already: connect 'c'" in found.text
    opened = platform().replace("0 0 .3 1 0 0 0", "0 0 .2 1 0 0 0")
    (found,) = lines(as_mechanism(opened), "tie", "beware")
    assert found.data["missed"] == pytest.approx(0.1) and "keeps all ties was found" in found.text


def test_loops_that_no_configuration_closes_are_wrong_with_their_name():
    far = '<weld name="far" body1="leg" body2="world" relpose="0 0 5 1 0 0 0"/>'
    (found,) = lines(as_mechanism(platform(more=far)), "tie", "wrong")
    assert "could not be closed" in found.text and "weld 'far'" in found.text


def test_contradictory_locks_and_ties_that_can_t_be_looked_at_are_wrong():
    locks = '<joint joint1="lift" polycoef="0.1 0 0 0 0"/><joint joint1="lift" polycoef="0.2 0 0 0 0"/>'
    (found,) = [f for f in as_mechanism(platform(more=locks)) if f.level == "wrong"]
    assert "lift" in found.text


def test_a_hand_s_sites_are_told_in_one_line_and_its_joints_together():
    findings = inspect_scene(robot_scene("shadow_hand"))
    (found,) = [f for f in lines(findings, "tool") if "could_be" in f.data]
    assert len(found.data["could_be"]) == 15 and "--goals" in found.text
    (summary,) = lines(findings, "mechanism")
    assert summary.data["driven"] == 24


@pytest.mark.parametrize("name", ["stewart", "stewart_dietmaier", "linkage_gripper"])
def test_our_own_mechanisms_have_nothing_wrong(capsys, name):
    with pytest.raises(SystemExit) as stop:
        main(["check", name, "--json"])
    found = json.loads(capsys.readouterr().out)
    assert stop.value.code == exit_codes.DONE and not found["problems"]
    assert any("hold at the start" in line for line in found["contents"])


def test_a_file_without_a_robot_is_checked_as_the_mechanism_that_it_is(capsys, tmp_path):
    (tmp_path / "plate.xml").write_text(platform())
    with pytest.raises(SystemExit) as stop:
        main(["check", str(tmp_path / "plate.xml")])
    out = capsys.readouterr().out
    assert (
        stop.value.code == exit_codes.DONE
        and "plate.xml: mechanism" in out
        and "BEWARE  no robot is found" in out
    )
    assert "4 degrees of freedom are left of 10" in out
