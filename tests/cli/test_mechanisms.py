"""`ik` of mechanisms: known by themselves; answers tell all that was measured, bad input is one message."""

import json

import numpy as np
import pytest

from workcell.cli import exit_codes, main

FOUR_BAR = """<mujoco><compiler angle="radian"/><default><geom type="capsule" size=".01"/></default><worldbody>
  <body name="crank"><joint name="crank" axis="0 1 0"/><geom name="crank" fromto="0 0 .03 .1 0 .03"/>
    <body name="rod" pos=".1 0 0"><joint name="rod" axis="0 1 0"/>
      <geom name="rod" fromto="0 .05 0 .3 .05 0"/><site name="eye" pos=".15 0 0"/></body></body>
  <body name="rocker" pos=".3 0 0"><joint name="rocker" axis="0 1 0"/>
    <geom name="rocker" fromto="0 -.05 0 0 -.05 .25"/></body></worldbody>
  <equality><connect name="pin" body1="rod" body2="rocker" anchor=".3 0 0"/></equality>
  <actuator><motor joint="crank"/></actuator></mujoco>"""


def call(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main(list(arguments))
    output = capsys.readouterr()
    return stop.value.code, output.out, output.err


@pytest.fixture
def four_bar(tmp_path):
    path = tmp_path / "four_bar.xml"
    path.write_text(FOUR_BAR)
    return str(path)


def goals(tmp_path, text):
    path = tmp_path / "goals.toml"
    path.write_text('format = "workcell-goals/1"\n' + text)
    return str(path)


def at(x, z, frame="eye"):
    return f'[[goal]]\nframe = "{frame}"\nposition = [{x}, 0.0, {z}]\n'


def test_a_platform_is_answered_without_being_told_what_it_is(capsys):
    pose = ("0.5", "0", "0.9", "1", "0", "0", "0")
    code, out, err = call(capsys, "ik", "stewart", "--tool", "platform", "--pose", *pose)
    assert (code, err) == (exit_codes.DONE, "")
    first, second, *rest = out.splitlines()
    assert first == "as a mechanism: 13 joints (6 slide, 6 ball, 1 floating), tied by 6 connects"
    assert second.startswith("SOLVED: ") and any(
        line.startswith("  ties are missed by at most") for line in rest
    )
    code, out, _ = call(
        capsys, "ik", "stewart", "--tool", "platform", "--pose", *pose, "--json", "--solver", "ikspark"
    )
    answer = json.loads(out)
    assert answer["as"] == "mechanism" and answer["status"] == "SOLVED" and answer["closure_error"] < 1e-6
    values = answer["joint_values"]
    assert (
        len(values["leg1_ball"]) == 4
        and isinstance(values["leg1_slide"], float)
        and len(values["platform"]) == 7
    )
    # the legs are as long as the platform's pose says
    assert np.ravel([answer["q"]]).size == 6 * 5 + 7 and answer["stats"]["ikspark.sdps"] > 0


def test_out_of_reach_is_proved_with_exit_3(capsys):
    pose = ("5", "0", "0.9", "1", "0", "0", "0")
    code, out, _ = call(capsys, "ik", "stewart", "--tool", "platform", "--pose", *pose)
    assert code == exit_codes.IMPOSSIBLE and "UNREACHABLE" in out and "proof (mechanism/1)" in out


ARMS = """<mujoco><worldbody>{}</worldbody><actuator>{}</actuator></mujoco>"""
ARM = """<body name="{0}" pos="0 {1} 0"><joint name="{0}_a" axis="0 0 1" range="-90 90"/><geom size=".02"/>
  <body pos=".3 0 0"><joint name="{0}_b" axis="0 1 0" range="-90 90"/><geom size=".02"/>
    <site name="{0}_tool" pos=".2 0 0"/></body></body>"""


@pytest.fixture
def two_arms(tmp_path):
    path = tmp_path / "two_arms.xml"
    bodies = "".join(ARM.format(name, y) for name, y in (("left", 1), ("right", -1)))
    motors = "".join(f'<motor joint="{name}_{joint}"/>' for name in ("left", "right") for joint in "ab")
    path.write_text(ARMS.format(f'<body name="torso"><geom size=".05"/>{bodies}</body>', motors))
    return str(path)


STRAIGHT = ("0.5", "-1", "0", "1", "0", "0", "0")


def test_a_tool_that_only_another_arm_has_makes_the_robot_a_mechanism(capsys, two_arms):
    code, out, _ = call(capsys, "ik", two_arms, "--tool", "right_tool", "--pose", *STRAIGHT)
    assert code == exit_codes.DONE
    assert out.startswith(
        "as a mechanism (there is no tool named 'right_tool'): 4 joints (4 hinge), no loops"
    )


def test_serial_robots_stay_what_they_are(capsys, two_arms):
    pose = (STRAIGHT[0], "1", *STRAIGHT[2:])
    code, out, _ = call(capsys, "ik", two_arms, "--pose", *pose, "--json")
    assert code == exit_codes.DONE and "as" not in json.loads(out) and len(json.loads(out)["q"]) == 2
    more = ("--mechanism", "--tool", "left_tool", "--form", "rotation", "--solver", "ikspark", "--json")
    code, out, _ = call(capsys, "ik", two_arms, "--pose", *pose, *more)
    answer = json.loads(out)
    assert code == exit_codes.DONE and answer["as"] == "mechanism" and answer["position_error_m"] < 1e-6
    code, out, _ = call(
        capsys, "ik", two_arms, "--pose", *pose, "--mechanism", "--tool", "left_tool", "--goal", "axis"
    )
    assert code == exit_codes.DONE and "SOLVED" in out


def test_goals_and_regions_of_a_linkage_are_reached_together(capsys, four_bar, tmp_path):
    region = '[[region]]\nframe = "eye"\nnormal = [0, 0, 1]\noffset = 0.05\n'
    code, out, _ = call(capsys, "ik", four_bar, "--goals", goals(tmp_path, region), "--json")
    answer = json.loads(out)
    assert code == exit_codes.DONE and answer["region_error_m"] < 1e-6 and answer["closure_error"] < 1e-6
    assert answer["loops"] == 1 and set(answer["joint_values"]) == {"crank", "rod", "rocker"}
    code, out, _ = call(capsys, "ik", four_bar, "--goals", goals(tmp_path, at(2.0, 0.0)))
    assert code == exit_codes.IMPOSSIBLE and "UNREACHABLE" in out


def test_contacts_of_fingers_may_touch_and_nothing_else(capsys):
    code, out, _ = call(capsys, "ik", "hand_cube", "--goals", "examples/fingers_on_a_cube.toml", "--json")
    answer = json.loads(out)
    assert code == exit_codes.DONE and answer["region_error_m"] < 1e-6 and answer["clearance_m"] >= 0.0


def test_the_closest_configuration_has_its_cost_and_a_bound(capsys, four_bar, tmp_path):
    question = goals(tmp_path, at(2.0, 0.0) + "[options]\nclosest = true\n")
    code, out, _ = call(capsys, "ik", four_bar, "--goals", question, "--json")
    answer = json.loads(out)
    assert code == exit_codes.DONE and 0.0 <= answer["bound"] <= answer["cost"] + 1e-9
    assert answer["cost"] == pytest.approx(answer["position_error_m"] ** 2, rel=1e-6)
    code, out, _ = call(capsys, "ik", four_bar, "--goals", goals(tmp_path, at(2.0, 0.0)), "--closest")
    assert code == exit_codes.DONE and "proved: none is below" in out
    code, _, err = call(capsys, "ik", four_bar, "--goals", question, "--closest", "--solver", "chains")
    assert code == exit_codes.BAD_INPUT and "--closest" in err


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (at(0.1, 0.1, "eyes"), "did you mean eye"),
        (at(0.1, 0.1) + at(0.2, 0.1), "goal 1 of 'eye'"),
        ('[[region]]\nframe = "eye"\nA = [[1, 0, 0], [-1, 0, 0]]\nb = [0, -1]\n', "it is empty"),
        ('[[contact]]\nframe = "eye"\non = "rod"\nface = "+x"\n', "not a box"),
        (
            '[[goal]]\nframe = "crank"\nposition = [1, 0, 0]\n[options]\nmoving = ["rocker"]\n',
            "nothing moves it",
        ),
        ("[[goal]\n", "not valid TOML"),
        ("", "goal is missing"),
    ],
)
def test_bad_questions_give_one_message_and_exit_2(capsys, four_bar, tmp_path, text, says):
    code, out, err = call(capsys, "ik", four_bar, "--goals", goals(tmp_path, text))
    assert code == exit_codes.BAD_INPUT and out == ""
    assert says in err and "Traceback" not in err and len(err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("mend", "says"),
    [
        (('name="rod" axis', 'name="rod" range="1 -1" limited="true" axis'), "rod"),
        (("</equality>", '<connect body1="rocker" body2="world" anchor="0 0 .1"/></equality>'), ""),
        (("<actuator>", '<equality><joint joint1="rod" polycoef="1 0 0 0 0"/><joint joint1="rod" polycoef="2 0 0 0 0"/>'
          "</equality><actuator>"), "rod"),
    ],
)  # fmt: skip
def test_models_that_can_t_be_are_refused_by_name(capsys, tmp_path, mend, says):
    path = tmp_path / "model.xml"
    path.write_text(FOUR_BAR.replace(*mend))
    code, out, err = call(capsys, "ik", str(path), "--mechanism", "--tool", "eye", "--pose", *"0001000")
    if says:
        assert code == exit_codes.BAD_INPUT and says in err and len(err.strip().splitlines()) == 1
    else:
        assert code in (exit_codes.NOT_ACHIEVED, exit_codes.IMPOSSIBLE) and "Traceback" not in out + err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("stewart", "--pose", *"0001000"), "which frame is to be at the pose?"),
        (("stewart", "--tool", "platfrom", "--pose", *"0001000"), "did you mean platform"),
        (
            ("stewart", "--tool", "platform", "--pose", *"0001000", "--solver", "branch"),
            "no solver named 'branch'",
        ),
        (("stewrat", "--mechanism", "--pose", *"0001000"), "did you mean stewart"),
        (("stewart", "--goals", "no_such.toml"), "can't read this file"),
        (("linkage_gripper", "--mechanism", "--pose", *"5001000"), "nothing moves it"),
    ],
)
def test_bad_arguments_give_one_message_and_exit_2(capsys, arguments, says):
    code, out, err = call(capsys, "ik", *arguments)
    assert code == exit_codes.BAD_INPUT and out == ""
    assert says in err and len(err.strip().splitlines()) == 1


def test_a_question_is_a_pose_or_a_file(capsys):
    for arguments in (("ik", "stewart"), ("ik", "stewart", "--goals", "a.toml", "--pose", *"0001000")):
        code, _, err = call(capsys, *arguments)
        assert code == exit_codes.BAD_INPUT and "--goals" in err and "usage: workcell ik" in err
