"""Problem-set files: what is read, and that everything wrong is named."""

import copy
import json
from pathlib import Path

import numpy as np
import pytest

from tests.ik.arms import beads, planar, random_arm, seven
from tests.sets.documents import problem_set_document
from workcell.bench.reference.generate import KINDS, generate
from workcell.errors import InputError, UnknownNameError
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.elementary.bounds import prove_impossible
from workcell.pose import Pose, quat_to_matrix
from workcell.sets.problems import load_problem_set, parse_problem_set

DATA = Path(__file__).parent / "files"
SEVEN = json.loads((DATA / "seven_random.json").read_text())


def test_a_file_is_read_as_it_stands():
    problem_set = load_problem_set(DATA / "seven_random.json")
    assert problem_set.name == "random" and problem_set.robot.name == "seven" and len(problem_set) == 4
    assert problem_set.robot.dof == 7 and len(problem_set.cover) == 14 and problem_set.cover.kind == "given"
    joint = SEVEN["robot"]["joints"][2]
    assert np.allclose(problem_set.robot.joint_xyz[2], joint["xyz"])
    assert np.allclose(problem_set.robot.joint_rotation[2], quat_to_matrix(joint["quat"]))
    first, second, third, far = problem_set.problems
    assert first.id == "seven_random_0000" and first.start is None
    assert [piece.kind for piece in second.problem.obstacles] == ["sphere", "cylinder"]
    assert np.allclose(second.problem.obstacles[1].size, [0.05, 0.3])
    assert np.allclose(second.start, 0.1)
    assert np.allclose(third.problem.obstacles[0].pose.quat_wxyz, [1, 0, 0, 0])
    assert far.problem.obstacles == ()
    target = SEVEN["problems"][0]["target"]
    assert np.allclose(first.problem.target.position, target["xyz"])
    assert np.allclose(first.problem.target.rotation, quat_to_matrix(target["quat"]), atol=1e-8)


@pytest.mark.parametrize("kind", tuple(KINDS))
def test_generated_sets_survive_a_file(kind, tmp_path):
    made = generate(seven(), beads(seven(), 0.04), kind, 4, seed=3)
    (tmp_path / "set.json").write_text(json.dumps(problem_set_document(made)))
    read = load_problem_set(tmp_path / "set.json")
    assert [p.id for p in read.problems] == [p.id for p in made.problems]
    for a, b in zip(made.problems, read.problems, strict=True):
        assert np.allclose(a.problem.target.matrix, b.problem.target.matrix, atol=1e-12)
        assert len(a.problem.obstacles) == len(b.problem.obstacles)
        for one, two in zip(a.problem.obstacles, b.problem.obstacles, strict=True):
            assert one.kind == two.kind and np.allclose(one.size, two.size)
            assert np.allclose(one.pose.matrix, two.pose.matrix, atol=1e-12)
    again = generate(seven(), beads(seven(), 0.04), kind, 4, seed=3)
    assert problem_set_document(again) == problem_set_document(made)
    assert problem_set_document(generate(seven(), beads(seven(), 0.04), kind, 4, 4)) != problem_set_document(
        made
    )


def test_generated_unreachable_targets_are_all_proved():
    made = generate(seven(), beads(seven(), 0.04), "unreachable", 10, seed=1)
    kinds = [certificate.kind for p in made.problems if (certificate := prove_impossible(p.problem))]
    assert kinds == ["reach", "last_link"] * 5


def test_generating_what_makes_no_sense(monkeypatch):
    monkeypatch.setattr("workcell.bench.reference.generate._TRIES", 20)
    with pytest.raises(UnknownNameError, match="did you mean workcell"):
        generate(seven(), beads(seven()), "workcel", 1)
    with pytest.raises(InputError, match="last link"):
        generate(planar(), SphereCover(np.array([1]), np.zeros((1, 3)), np.ones(1)), "unreachable", 2)
    with pytest.raises(InputError, match="no room"):
        generate(planar(), SphereCover(np.array([1]), np.zeros((1, 3)), np.full(1, 9.0)), "random", 1)
    with pytest.raises(InputError, match="no clear configuration"):
        generate(planar(), SphereCover(np.array([1]), np.zeros((1, 3)), np.full(1, 9.0)), "workcell", 1)


def test_what_the_format_can_not_say_is_not_written():
    sliding = random_arm(np.random.default_rng(0), sliding=True)
    with pytest.raises(InputError, match="revolute"):
        problem_set_document(generate(sliding, beads(sliding), "free", 1))
    made = generate(planar(), beads(planar()), "free", 1)
    floor = Piece("floor", "halfspace", Pose.identity(), np.zeros(0))
    named = made.problems[0]
    object.__setattr__(named.problem, "obstacles", (floor,))
    with pytest.raises(InputError, match="halfspace"):
        problem_set_document(made)


def _set(document, path, value):
    *parents, last = path
    for key in parents:
        document = document[key]
    if value is _GONE:
        del document[last]
    else:
        document[last] = value


_GONE = object()
_NAN = float("nan")
_JOINT, _PROBLEM = ("robot", "joints", 1), ("problems", 2)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("format",), "workcell-ikset/2", ["format", "workcell-ikset/1"]),
        (("format",), _GONE, ["'format' is missing"]),
        (("format",), 1, ["format", "expected a name"]),
        (("robot",), _GONE, ["'robot' is missing"]),
        (("robot",), [], ["robot", "expected an object"]),
        (("robot", "name"), "", ["name"]),
        (("robot", "joints"), [], ["no joint"]),
        (("robot", "joints"), {}, ["joints", "expected a list"]),
        ((*_JOINT, "name"), "j1", ["two joints are named 'j1'"]),
        ((*_JOINT, "xyz"), [0, 0], ["joints[1], xyz", "expected 3 numbers, found 2"]),
        ((*_JOINT, "xyz"), [0, 0, "0"], ["joints[1], xyz[2]", "expected a number"]),
        ((*_JOINT, "xyz"), [0, 0, True], ["expected a number"]),
        ((*_JOINT, "xyz"), [0, 0, 10**400], ["finite"]),
        ((*_JOINT, "quat"), [1, 0, 0, 0.1], ["joints[1], quat", "unit"]),
        ((*_JOINT, "quat"), [0, 0, 0, 0], ["length 0"]),
        ((*_JOINT, "axis"), [0, 0, 2], ["axis", "unit"]),
        ((*_JOINT, "axis"), [0, 0, 0], ["axis", "unit"]),
        ((*_JOINT, "lower"), 3.0, ["j2", "reversed"]),
        ((*_JOINT, "upper"), None, ["upper", "expected a number, found null"]),
        ((*_JOINT, "lower"), _GONE, ["'lower' is missing"]),
        (("robot", "tool"), _GONE, ["'tool' is missing"]),
        (("robot", "tool", "quat"), [0.5, 0.5, 0.5], ["tool, quat", "expected 4"]),
        (("robot", "spheres"), None, ["spheres", "expected a list"]),
        (("robot", "spheres", 3), [1, 0, 0, 0.1], ["spheres[3]", "expected 5 numbers"]),
        (("robot", "spheres", 3, 0), 8, ["spheres[3]", "no link 8", "from 0 (base) to 7"]),
        (("robot", "spheres", 3, 0), -1, ["no link -1"]),
        (("robot", "spheres", 3, 0), 1.5, ["no link 1.5"]),
        (("robot", "spheres", 3, 4), 0, ["spheres[3]", "radius"]),
        (("robot", "spheres", 3, 4), _NAN, ["spheres[3][4]", "finite"]),
        (("problems",), _GONE, ["'problems' is missing"]),
        (("problems",), "none", ["problems", "expected a list"]),
        (_PROBLEM, 7, ["problems[2]", "expected an object"]),
        ((*_PROBLEM, "id"), "seven_random_0000", ["occurs twice"]),
        ((*_PROBLEM, "id"), _GONE, ["problems[2]", "'id' is missing"]),
        ((*_PROBLEM, "id"), 2, ["problems[2], id", "expected a name"]),
        ((*_PROBLEM, "target"), _GONE, ["problem 'seven_random_0002'", "'target' is missing"]),
        ((*_PROBLEM, "target", "xyz", 0), _NAN, ["problem 'seven_random_0002', target, xyz[0]", "finite"]),
        ((*_PROBLEM, "target", "xyz", 0), float("inf"), ["finite"]),
        ((*_PROBLEM, "target", "quat"), [1, 1, 0, 0], ["seven_random_0002", "quat", "unit"]),
        ((*_PROBLEM, "obstacles"), _GONE, ["'obstacles' is missing"]),
        ((*_PROBLEM, "obstacles"), [], ["obstacles", "expected an object"]),
        ((*_PROBLEM, "obstacles", "cones"), [], ["cones", "boxes, spheres, cylinders"]),
        ((*_PROBLEM, "obstacles", "boxes", 1, "half"), [0.1, 0, 0.1], ["boxes[1], half[1]", "positive"]),
        ((*_PROBLEM, "obstacles", "boxes", 1, "half"), [0.1, 0.1], ["boxes[1], half", "expected 3"]),
        ((*_PROBLEM, "obstacles", "boxes", 1, "centre"), _GONE, ["boxes[1]", "'centre' is missing"]),
        ((*_PROBLEM, "obstacles", "boxes", 1, "quat"), [2, 0, 0, 0], ["boxes[1], quat", "unit"]),
        (("problems", 1, "obstacles", "spheres", 0, "radius"), -0.1, ["spheres[0], radius", "positive"]),
        (("problems", 1, "obstacles", "cylinders", 0, "half_length"), 0, ["half_length", "positive"]),
        (("problems", 1, "start"), [0.0] * 6, ["start", "expected 7"]),
        (("problems", 1, "start"), [9.0] * 7, ["start", "'j1' starts at 9", "outside its limits"]),
    ],
)
def test_everything_wrong_is_named(path, value, words, tmp_path):
    document = copy.deepcopy(SEVEN)
    _set(document, path, value)
    with pytest.raises(InputError) as error:
        parse_problem_set(document, "sets/seven.json")
    for word in ["sets/seven.json", *words]:
        assert word in str(error.value), str(error.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is not JSON"),
        (b"{", "is not JSON"),
        (b'{"format": "workcell-ikset/1",}', "line 1"),
        (b"[]", "expected an object"),
        (b"null", "expected an object"),
        (b"\xff\xfe\x00", "is not a text file"),
        (b"[" * 100_000, "set.json"),
        (b"9" * 5_000, "too many digits"),
    ],
)
def test_files_that_are_no_sets(content, words, tmp_path):
    path = tmp_path / "set.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"set\.json") as error:
        load_problem_set(path)
    assert words in str(error.value)


def test_files_that_can_not_be_read(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        load_problem_set(tmp_path / "missing.json")
    with pytest.raises(InputError, match="directory"):
        load_problem_set(tmp_path)


def test_an_empty_set_and_a_robot_without_spheres_are_fine():
    document = copy.deepcopy(SEVEN)
    document["problems"], document["robot"]["spheres"] = [], []
    problem_set = parse_problem_set(document)
    assert len(problem_set) == 0 and len(problem_set.cover) == 0
