"""Hostile arguments and files: a message and an exit code of the contract, never a traceback, never a hang."""

import copy
import json
import os
import random
import re
import subprocess
import sys

import pytest

from workcell.cli import exit_codes, main

ANSWERED = (exit_codes.DONE, exit_codes.NOT_ACHIEVED, exit_codes.BAD_INPUT, exit_codes.IMPOSSIBLE)
HOSTILE = (
    1e300,
    -1e300,
    10**400,
    float("nan"),
    float("inf"),
    None,
    "",
    [],
    {},
    True,
    "\ud800",
    "a\x1b[31m\n\rb",
)
HOSTILE += ("x" * 100000, -1, 0, 1e-320, [[[]]], {"a": 1}, 2**63, 1.5, "nan", "\u202e")

SET = {
    "format": "workcell-ikset/1",
    "set": "small",
    "robot": {
        "name": "p",
        "joints": [
            {"name": n, "xyz": [x, 0, 0.1], "quat": [1, 0, 0, 0], "axis": a, "lower": -2, "upper": 2}
            for n, x, a in (("a", 0, [0, 0, 1]), ("b", 0.3, [0, 1, 0]))
        ],
        "tool": {"xyz": [0.3, 0, 0], "quat": [1, 0, 0, 0]},
        "spheres": [[1, 0.1, 0, 0, 0.05], [2, 0.1, 0, 0, 0.05]],
    },
    "problems": [
        {
            "id": "one",
            "target": {"xyz": [0.6, 0, 0.2], "quat": [1, 0, 0, 0]},
            "obstacles": {"boxes": [{"centre": [2, 0, 0], "half": [0.1, 0.1, 0.1], "quat": [1, 0, 0, 0]}]},
            "start": [0, 0],
        }
    ],
}
ANSWER = {"id": "one", "status": "SOLVED", "q": [0.0, 0.0], "time_s": 0.1, "cpu_s": 0.1, "certificate": None}
PATH = {"id": "one", "status": "SOLVED", "path": [[0.0, 0.0], [0.0, 0.0]], "proved": True, "cpu_s": 0.1}
PROOF = {
    **ANSWER,
    "status": "UNREACHABLE",
    "q": None,
    "certificate": {"kind": "reach", "problem_hash": "x", "scope": "kinematics", "margin": 1.0, "data": {}},
}

ARM = """<mujoco><worldbody><body name="a" gravcomp="1"><joint name="j" axis="0 0 1" range="-1 1"/>
  <geom name="g" type="capsule" size=".05 .1" mass="1"/><body name="b" pos="0 0 .3"><joint name="k" axis="0 1 0"
  range="-1 1" stiffness="3"/><geom type="box" size=".05 .05 .1" pos="0 0 .2"/><site name="tool" pos="0 0 .4"/></body>
  </body></worldbody><actuator><motor name="m" joint="j" ctrlrange="-5 5"/><motor joint="k"/></actuator></mujoco>"""
URDF = """<robot name="r"><link name="a"/><link name="b"><collision><geometry><sphere radius=".1"/></geometry>
  </collision><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 1"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" effort="9" velocity="2"/></joint></robot>"""
VALUES = (
    "1e300",
    "nan",
    "inf",
    "",
    "x",
    "1 2 3 4 5 6 7",
    "9" * 5000,
    "a&#10;b",
    "-1",
    "0",
    "j",
    "true",
    "\u202e",
)
TASK = """format = "workcell-task/1"
name = "t"
cell = "arm.xml"
[[goals]]
name = "g"
robot = "a"
xyz = [0, 0, 0.5]
[task]
speed = 0.5
"""
TASK_VALUES = ('"x"', "1e300", "nan", "-1", "[]", "{}", "true", '""', "9" * 5000, "1" + "0" * 400, "[[[1]]]")


def answered(capsys, *arguments):
    """The exit code and both outputs of a command, which says nothing that a terminal would obey."""
    with pytest.raises(SystemExit) as stop:
        main(list(arguments))
    told = capsys.readouterr()
    assert stop.value.code in ANSWERED, (arguments, told.err)
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", told.out + told.err), arguments
    assert "Traceback" not in told.out + told.err
    return stop.value.code, told.out, told.err


def places(value):
    """(container, key) of every node below a JSON value."""
    for key in value if isinstance(value, dict) else range(len(value)):
        yield value, key
        if isinstance(value[key], (dict, list)):
            yield from places(value[key])


def mutated(value, rng):
    value = copy.deepcopy(value)
    container, key = rng.choice(list(places(value)))
    if rng.random() < 0.1:
        del container[key]
    else:
        container[key] = rng.choice(HOSTILE)
    return value


@pytest.mark.parametrize("seed", range(4))
def test_problem_sets(capsys, tmp_path, seed):
    rng, path = random.Random(seed), tmp_path / "set.json"
    for _ in range(30):
        path.write_text(json.dumps(mutated(SET, rng)))
        answered(capsys, "check", str(path))


def test_problem_sets_that_are_solved_and_planned(capsys, tmp_path):
    rng, path = random.Random(9), tmp_path / "set.json"
    path.write_text(json.dumps(SET))
    assert answered(capsys, "solve", str(path), "--budget-s", "0.5", "--solver", "hjcd")[0] == exit_codes.DONE
    for _ in range(6):
        path.write_text(json.dumps(mutated(SET, rng)))
        solved = answered(capsys, "solve", str(path), "--budget-s", "0.05", "--solver", "hjcd")
        planned = answered(capsys, "plan", str(path), "--budget-s", "0.05")
        for code, out, err in (solved, planned):
            assert (code == exit_codes.BAD_INPUT) == (len(err.strip().splitlines()) == 1), err
            assert code == exit_codes.BAD_INPUT or out.strip()


@pytest.mark.parametrize("line", [ANSWER, PATH, PROOF], ids=["answer", "path", "proof"])
def test_answers(capsys, tmp_path, line):
    rng = random.Random(1)
    problems, answers = tmp_path / "set.json", tmp_path / "answers.jsonl"
    problems.write_text(json.dumps(SET))
    for _ in range(40):
        answers.write_text(json.dumps(mutated(line, rng)) + "\n")
        answered(capsys, "verify", str(problems), str(answers))


@pytest.mark.parametrize(("text", "suffix"), [(ARM, ".xml"), (URDF, ".urdf")])
def test_models(capsys, tmp_path, text, suffix):
    rng, path = random.Random(2), tmp_path / f"model{suffix}"
    for _ in range(40):
        at = rng.choice(list(re.finditer(r'="([^"]*)"', text)))
        path.write_text(text[: at.start(1)] + rng.choice(VALUES) + text[at.end(1) :])
        answered(capsys, "check", str(path))
    for cut in range(0, len(text), 60):
        path.write_text(text[:cut] + rng.choice(("", "<", "&", "\x00", "\ufeff")) + text[cut + 3 :])
        answered(capsys, "check", str(path))


def test_tasks(capsys, tmp_path):
    rng, path = random.Random(3), tmp_path / "t.toml"
    (tmp_path / "arm.xml").write_text(ARM)
    for _ in range(40):
        at = rng.choice(list(re.finditer(r"= (.*)", TASK)))
        path.write_text(TASK[: at.start(1)] + rng.choice(TASK_VALUES) + TASK[at.end(1) :])
        answered(capsys, "check", str(path))


SCRIPTS = {
    "raise SystemExit(5)": 2,
    "def run(job):\n    raise SystemExit(5)": 2,
    "def run(job):\n    raise BaseException('x')": 2,
    "def run(job):\n    raise Exception('\\x1b[31m\\ud800')": 2,
    "def run(job):\n    run(job)": 2,
    "def run(job):\n    return 5\n\x00": 2,
    "class Run:\n    def __call__(self, job):\n        1 / 0\nrun = Run()": 2,
    "run = 3": 2,
    "": 2,
}


@pytest.mark.parametrize("script", SCRIPTS)
def test_scripts(capsys, tmp_path, script):
    (tmp_path / "t.toml").write_text('format = "workcell-task/1"\ncell = "arm.xml"\n')
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "t.py").write_text(script)
    code, _, err = answered(capsys, "run", str(tmp_path / "t.toml"), "--out", str(tmp_path / "out"))
    assert (code, err.startswith("workcell: ")) == (SCRIPTS[script], True)


@pytest.fixture(scope="module")
def strange_files(tmp_path_factory):
    """What may stand where a file is expected."""
    folder = tmp_path_factory.mktemp("strange")
    text = json.dumps(SET).encode()
    contents = {
        "empty": b"",
        "binary": random.Random(0).randbytes(2000),
        "bom": b"\xef\xbb\xbf" + text,
        "crlf": text.replace(b",", b",\r\n"),
        "deep": b"[" * 100000,
        "twice": b'{"format": "workcell-ikset/1", "format": "x"}',
        "digits": b'{"format":' + b"9" * 5000 + b"}",
        "utf16": json.dumps(SET).encode("utf-16"),
        "zeros": b"\0" * 100,
    }
    for name, data in contents.items():
        (folder / name).write_bytes(data)
    os.mkfifo(folder / "pipe")
    (folder / "folder").mkdir()
    (folder / "loop").symlink_to("loop")
    (folder / "device").symlink_to("/dev/zero")
    (folder / "nowhere").symlink_to("nothing")
    return folder


@pytest.mark.parametrize("suffix", [".json", ".toml", ".xml", ".urdf", ".rrd", ".py"])
def test_what_stands_where_a_file_is_expected(capsys, strange_files, tmp_path, suffix):
    (tmp_path / "set.json").write_text(json.dumps(SET))
    given = [str(path) for path in strange_files.iterdir()]
    names = []
    for path in given:
        link = tmp_path / (path.rsplit("/", 1)[1] + suffix)
        link.symlink_to(path)
        names.append(str(link))
    names += [
        "",
        "/dev/null",
        f"\ud800{suffix}",
        f"a\x00b{suffix}",
        "x" * 5000 + suffix,
        f"\x1b[31mred{suffix}",
    ]
    names += [f"~nobody-of-that-name/x{suffix}", "/nonexistent/x" + suffix]
    whole = {str(tmp_path / f"{name}.json") for name in ("bom", "crlf")}
    for name in names:
        if suffix == ".json":
            assert (answered(capsys, "check", name)[0] == exit_codes.DONE) == (name in whole)
            answered(capsys, "verify", str(tmp_path / "set.json"), name)
            continue
        commands = (
            [("review", name)] if suffix == ".rrd" else [("check", name), ("decompose", name), ("run", name)]
        )
        for command in commands:
            assert answered(capsys, *command)[0] == exit_codes.BAD_INPUT, command


def test_a_certificate_in_a_pipe_a_device_or_a_folder(capsys, strange_files, tmp_path):
    (tmp_path / "set.json").write_text(json.dumps(SET))
    for name in ("pipe", "device", "folder", "loop", "nowhere", "binary", "empty", "deep"):
        line = {**PROOF, "certificate": str(strange_files / name)}
        (tmp_path / "answers.jsonl").write_text(json.dumps(line) + "\n")
        code, out, _ = answered(capsys, "verify", str(tmp_path / "set.json"), str(tmp_path / "answers.jsonl"))
        assert code == exit_codes.NOT_ACHIEVED and "refused" in out


@pytest.mark.parametrize(
    "asset",
    [
        '<mesh name="m" file="{}"/>',
        '<hfield name="m" file="{}" size="1 1 1 1"/>',
        '<texture name="m" type="2d" file="{}"/>',
    ],
)
def test_a_model_that_names_a_pipe_or_a_folder(capsys, strange_files, tmp_path, asset):
    path = tmp_path / "model.xml"
    for name in ("pipe", "device", "folder"):
        (tmp_path / f"{name}.png").unlink(missing_ok=True)
        (tmp_path / f"{name}.png").symlink_to(strange_files / name)
        path.write_text(
            ARM.replace("<worldbody>", f"<asset>{asset.format(f'{name}.png')}</asset><worldbody>")
        )
        code, _, err = answered(capsys, "check", str(path))
        assert (code == exit_codes.BAD_INPUT and "'m'" in err) or " m " in err


@pytest.mark.parametrize("value", ["1e300", "-1e300", "nan", "inf", "1e7", "9" * 400, "\ud800", "", "\x00"])
def test_numbers_of_arguments(capsys, value):
    for place in range(7):
        pose = ["0.5", "0", "0.4", "1", "0", "0", "0"]
        pose[place] = value
        assert answered(capsys, "ik", "ur10", "--pose", *pose, "--budget-s", "0.1")[0] == exit_codes.BAD_INPUT


def test_what_nobody_foresaw_is_one_message_with_a_file_to_report(capsys, monkeypatch, tmp_path):
    import importlib
    import tempfile

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    class Broken:
        def parse_args(self, arguments):
            raise ZeroDivisionError("an error\x1b[31m of\nmany lines")

    monkeypatch.setattr(importlib.import_module("workcell.cli.main"), "build_parser", Broken)
    with pytest.raises(SystemExit) as stop:
        main(["check", "x"])
    told = capsys.readouterr().err
    assert stop.value.code == exit_codes.UNFORESEEN == 70
    assert told.count("\n") == 1 and "\x1b" not in told and "ZeroDivisionError: an error" in told
    [report] = tmp_path.iterdir()
    assert str(report) in told
    assert "Traceback" in report.read_text() and "'check' 'x'" in report.read_text()


@pytest.mark.parametrize("redirection", ["| head -c 1", "> /dev/full", ">&-"])
def test_an_output_that_takes_nothing(redirection):
    script = "from workcell.cli import main; main(['check', 'sawyer'])"
    done = subprocess.run(
        f'"{sys.executable}" -c "{script}" {redirection}',
        shell=True,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        executable="/bin/bash",
    )
    assert "Traceback" not in done.stderr
    assert done.returncode == (exit_codes.BAD_INPUT if "full" in redirection else 0)
