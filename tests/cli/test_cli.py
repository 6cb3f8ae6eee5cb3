"""The command line: exit codes, one clear message for bad input, and `--json` that a program can read."""

import json
import subprocess
import sys

import pytest

from workcell.cli import exit_codes, main
from workcell.cli.parser import build_parser


def call(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main(list(arguments))
    output = capsys.readouterr()
    return stop.value.code, output.out, output.err


COMMANDS = ("robots", "check", "decompose", "ik", "solve", "verify", "run", "review", "bench")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(capsys, command):
    code, out, _ = call(capsys, command, "--help")
    assert code == 0 and f"example: workcell {command}" in out


def test_help_lists_every_command():
    text = build_parser().format_help()
    assert all(command in text for command in COMMANDS)


def test_robots(capsys):
    code, out, _ = call(capsys, "robots", "--json")
    rows = {row["name"]: row for row in json.loads(out)}
    assert code == 0 and {"sawyer", "ur10", "iiwa14"} <= set(rows)
    assert rows["sawyer"]["dof"] == 7 and rows["ur10"]["dof"] == 6
    assert rows["parallel_gripper"]["kind"] == "gripper"
    code, out, _ = call(capsys, "robots")
    assert code == 0 and "sawyer" in out


@pytest.mark.parametrize("name", ["sawyer", "ur10", "iiwa14", "parallel_gripper", "shelf", "shelf_grasp"])
def test_check_accepts_what_travels_with_workcell(capsys, name):
    code, out, _ = call(capsys, "check", name)
    assert code == exit_codes.DONE and "nothing wrong" in out


def test_check_names_joints_that_nothing_moves(capsys, tmp_path):
    path = tmp_path / "limp.xml"
    path.write_text(
        '<mujoco><worldbody><body><joint name="elbow"/><geom size="0.1"/></body></worldbody></mujoco>'
    )
    code, out, _ = call(capsys, "check", str(path))
    assert code == exit_codes.BAD_INPUT and "no joint is actuated" in out and "elbow" in out


def test_check_takes_a_urdf_in_the_working_folder(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.urdf").write_text(
        '<robot name="arm"><link name="base"/>'
        '<link name="upper"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        '</inertial><collision><geometry><sphere radius="0.1"/></geometry></collision></link>'
        '<joint name="lift" type="revolute"><parent link="base"/><child link="upper"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="1"/></joint></robot>'
    )
    code, out, err = call(capsys, "check", "arm.urdf")
    assert (code, err) == (exit_codes.DONE, "") and "1 joints" in out
    code, _, err = call(capsys, "check", "leg.urdf")
    assert code == exit_codes.BAD_INPUT and "no such file" in err


def test_ik_solves_and_says_so(capsys):
    code, out, _ = call(capsys, "ik", "ur10", "--pose", "0.5", "0.2", "0.6", "1", "0", "0", "0", "--json")
    answer = json.loads(out)
    assert code == exit_codes.DONE and answer["status"] == "SOLVED"
    assert len(answer["q"]) == 6 and answer["position_error_m"] < 1e-4


def test_ik_takes_negative_numbers_with_an_exponent(capsys):
    numbers = ("3.0", "-1e-3", "-.5", "1", "0", "0", "-1.0E-9")
    code, out, _ = call(capsys, "ik", "iiwa14", "--pose", *numbers)
    assert code == exit_codes.IMPOSSIBLE and out.startswith("UNREACHABLE")
    code, _, err = call(capsys, "ik", "iiwa14", "--pose", "-inf", *"001000")
    assert code == exit_codes.BAD_INPUT and "not finite" in err


def test_ik_out_of_reach_is_proved(capsys):
    code, out, _ = call(capsys, "ik", "iiwa14", "--pose", "3", "0", "0.5", "1", "0", "0", "0")
    assert code == exit_codes.IMPOSSIBLE and out.startswith("UNREACHABLE")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("check", "sawyr"), "did you mean sawyer"),
        (("check", "no/such/file.xml"), "no such file"),
        (("check", "nothing.json"), "nothing.json"),
        (("ik", "sawyr", "--pose", *"0001000"), "did you mean sawyer"),
        (("ik", "sawyer", "--pose", "nan", *"001000"), "not finite"),
        (("ik", "sawyer", "--pose", *"0011100"), "length"),
        (("ik", "sawyer", "--pose", *"0011000", "--solver", "ikspork"), "did you mean ikspark"),
        (("ik", "sawyer", "--pose", *"0011000", "--tool", "left"), "no tool named"),
        (("ik", "sawyer", "--pose", *"0011000", "--cell", "shelv"), "did you mean shelf"),
        (("solve", "missing.json"), "missing.json"),
        (("verify", "missing.json", "answers.jsonl"), "missing.json"),
        (("run", "shelf_gasp"), "did you mean shelf_grasp"),
        (("run", "shelf_grasp", "--planner", "rrt"), "no planner named"),
        (("run", "shelf_grasp", "--planner", "iksprak"), "did you mean ikspark"),
        (("run", "shelf_grasp", "--planner", "branch"), "branch answers single poses"),
        (("run", "shelf_grasp", "--planner", "hjcd"), "plan with ikspark, cidgik or auto"),
        (("review", "missing.rrd"), "missing.rrd"),
        (("bench", "nothing"), "no bench named"),
        (("bench",), "which bench"),
        (("decompose", "shelff"), "did you mean shelf"),
        (("decompose", "dual_arm_carry"), "name one (known: left, right)"),
        (("decompose", "shelf", "--robot", "ur10", "--overshoot", "1e-9"), "0.0005 or more"),
    ],
)
def test_bad_input_gives_one_message_and_exit_2(capsys, arguments, says):
    code, out, err = call(capsys, *arguments)
    assert code == exit_codes.BAD_INPUT
    assert says in err and "Traceback" not in err and out == ""
    assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("solve",),
        ("fly",),
        (),
        ("ik", "sawyer"),
        ("solve", "a.json", "--budget-s", "-1"),
        ("run", "x", "--seed", "-2"),
    ],
)
def test_bad_usage_gives_exit_2(capsys, arguments):
    code, _, err = call(capsys, *arguments)
    assert code == exit_codes.BAD_INPUT and "usage: workcell" in err


def test_a_malformed_problem_set_is_named(capsys, tmp_path):
    path = tmp_path / "set.json"
    path.write_text('{"format": "workcell-ikset/1", "problems": [')
    code, _, err = call(capsys, "check", str(path))
    assert code == exit_codes.BAD_INPUT and "set.json" in err


def test_a_bench_that_could_not_be_written_is_not_begun(capsys, tmp_path):
    (tmp_path / "file").write_text("")
    code, out, err = call(capsys, "bench", "ikspark-free", "--out", str(tmp_path / "file" / "rows.json"))
    assert code == exit_codes.BAD_INPUT and "can't be written" in err and out == ""


def test_the_installed_script_runs():
    code = "from workcell.cli import main; main(['--version'])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0 and result.stdout.startswith("workcell ")


@pytest.mark.parametrize(
    ("arguments", "redirection", "code"),
    [
        ("bench --list", "| true", 0),
        ("bench --list --json", "| true", 0),
        ("bench --list", ">&-", 0),
        ("check nothing.json", ">&- 2>&-", 2),
    ],
)
def test_closed_streams_end_nothing_with_a_traceback(arguments, redirection, code):
    command = f"{sys.executable} -c 'from workcell.cli import main; main()' {arguments} {redirection}"
    script = f"set -o pipefail; {command}"
    result = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (code, "", "")


def test_metrics_are_printed_with_their_units():
    from workcell.cli.models import metric_words

    assert metric_words("robot_cover_s", 29.0) == ("robot cover", "29.00 s")
    assert metric_words("robot_overshoot_max_m", 0.01999) == ("robot overshoot max", "19.99 mm")
    assert metric_words("reach_radius_m", 1.541) == ("reach radius", "1.54 m")
    assert metric_words("covered_fraction", 0.9984) == ("covered fraction", "99.8 %")
    assert metric_words("robot_cover_proved", True) == ("robot cover proved", "yes")
    assert metric_words("robot_cover_proved", False) == ("robot cover proved", "NO")
    assert metric_words("obstacles_out_of_reach", []) == ("obstacles out of reach", "none")
    assert metric_words("obstacles_cut_to_reach", ["floor", "wall"]) == (
        "obstacles cut to reach",
        "floor, wall",
    )
    assert metric_words("cuboid_margin_m", None) == ("cuboid margin", "-")
    assert metric_words("cuboids", 10) == ("cuboids", "10")


POSE = ("0.9", "0.3", "0.2", "1", "0", "0", "0")


def test_ik_takes_a_goal_of_less_than_a_pose(capsys):
    code, out, _ = call(capsys, "ik", "ur10", "--pose", *POSE, "--goal", "position", "--json")
    assert code == 0
    answer = json.loads(out)
    assert (
        answer["status"] == "SOLVED"
        and answer["position_error_m"] <= 1e-4
        and answer["rotation_error_rad"] == 0.0
    )
    code, _, error = call(capsys, "ik", "ur10", "--pose", *POSE, "--goal", "tip")
    assert code == 2 and "position" in error


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("solve", "set.json", "--out", "set.json"), "would overwrite"),
        (("solve", "set.json", "--out", "folder"), "directory"),
        (("solve", "set.json", "--out", "pipe"), "not a plain file"),
        (("plan", "set.json", "--out", "set.json"), "would overwrite"),
        (
            ("decompose", "shelf", "--robot", "ur10", "--out", "a.json", "--table", "a.json"),
            "would overwrite",
        ),
        (("bench", "ikspark-free", "--n", "1", "--out", "pipe"), "not a plain file"),
    ],
)
def test_no_output_takes_the_place_of_what_is_read_or_of_a_device(
    capsys, tmp_path, monkeypatch, arguments, says
):
    import os
    import shutil
    from pathlib import Path

    monkeypatch.chdir(tmp_path)
    shutil.copy(Path(__file__).parents[1] / "sets" / "files" / "planar_free.json", "set.json")
    Path("folder").mkdir()
    os.mkfifo("pipe")
    before = Path("set.json").read_bytes()
    code, out, err = call(capsys, *arguments)
    assert code == exit_codes.BAD_INPUT and says in err.lower() and out == ""
    assert Path("set.json").read_bytes() == before and not Path("pipe").is_file() and Path("folder").is_dir()


@pytest.mark.parametrize("option", ["--out", "--png", "--rrd", "--table"])
def test_an_empty_file_name_is_bad_usage(capsys, option):
    code, _, err = call(capsys, "decompose", "shelf", option, "")
    assert code == exit_codes.BAD_INPUT and "not the name of a file" in err


ARM = """<mujoco><worldbody><body name="base"><geom name="foot" size="0.1"/><body name="upper" pos="0 0 0.15">
<joint name="lift" axis="0 1 0" range="-60 60"/><geom name="rod" size="0.1"/><site name="tool" pos="0 0 0.3"/>
</body></body></worldbody><actuator><motor joint="lift"/></actuator></mujoco>"""


def test_check_of_an_own_arm_lists_its_joints_and_what_it_lacks(capsys, tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    code, out, _ = call(capsys, "check", str(path))
    assert code == exit_codes.BAD_INPUT and "lift: [-1.0472, 1.0472] rad" in out
    assert "no acceleration limit" in out and "foot and rod overlap by 50.0 mm" in out
    path.write_text(
        ARM.replace("<actuator>", '<contact><exclude body1="base" body2="upper"/></contact><actuator>')
    )
    assert '<exclude body1="base" body2="upper"/>' in out
    code, out, _ = call(capsys, "check", str(path))
    assert code == exit_codes.DONE and "nothing wrong" in out


def test_ik_puts_a_robot_file_of_the_working_folder_into_a_cell(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arm = ARM.replace('size="0.1"', 'size="0.05"')
    (tmp_path / "arm.mjcf").write_text(arm.replace("<worldb", '<option integrator="implicit"/><worldb'))
    (tmp_path / "cell.xml").write_text(
        '<mujoco><worldbody><geom name="wall" type="box" size="0.1 1 1" pos="2 0 0"/></worldbody></mujoco>'
    )
    pose = ("0", "0", "0.45", "1", "0", "0", "0")
    code, out, err = call(capsys, "ik", "arm.mjcf", "--cell", "cell.xml", "--pose", *pose)
    assert (code, err) == (exit_codes.DONE, "") and out.startswith("SOLVED")
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_ik_names_the_robots_of_a_cell_that_has_several(capsys):
    code, _, err = call(capsys, "ik", "ur10", "--cell", "dual_arm_carry", "--pose", *"0001000")
    assert code == exit_codes.BAD_INPUT and "known: left, right" in err


def test_a_pipe_gets_whole_lines(capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    _, out, _ = call(capsys, "bench", "--list")
    assert any(
        line.startswith(" covers ") and "n random points re-check each" in line for line in out.splitlines()
    )
