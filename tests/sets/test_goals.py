"""Files of goals: read strictly, and asked of the model that they name."""

import re
from pathlib import Path

import numpy as np
import pytest

from workcell.errors import WorkcellError
from workcell.model.loading.load import compile_spec, load_spec
from workcell.sets.goals import read_goals
from workcell.world.box_faces import body_geoms, standing_box
from workcell.world.mechanism_world import mechanism_in

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.toml"))
HEAD = 'format = "workcell-goals/1"\n'
GOAL = '[[goal]]\nframe = "tip"\nposition = [0.3, 0.0, 0.2]\n'
TURNED = '<mujoco><compiler angle="radian"/><worldbody><body name="block" pos=".4 .1 0" euler="0 0 1.5707963267948966">'
MODEL = (
    TURNED
    + """<geom name="block" type="box" size=".02 .04 .06"/><geom name="ball" size=".05" pos="0 0 .5"/></body>
  <body name="arm" pos="0 0 .2"><joint name="a" axis="0 1 0"/><geom name="upper" size=".02" pos=".1 0 0"/>
    <body name="hand" pos=".2 0 0"><joint name="b" type="ball"/><geom name="pad" type="box" size=".01 .01 .01"/>
      <geom name="seen" size=".01" contype="0" conaffinity="0"/><site name="tip" pos=".1 0 0"/></body></body>
  </worldbody></mujoco>"""
)


def read(tmp_path, text):
    path = tmp_path / "goals.toml"
    path.write_text(HEAD + text)
    return read_goals(path)


@pytest.fixture
def mechanism(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    return mechanism_in(path)


def test_everything_that_can_be_said_is_read(tmp_path):
    found = read(
        tmp_path,
        GOAL
        + """quat_wxyz = [0, 1, 0, 0]
[[goal]]
frame = "tip"
axis = [1, 0, 0]
direction = [0, 0, -1]
within_deg = 90
[[region]]
frame = "tip"
point = [0.1, 0, 0]
A = [[2, 0, 0], [0, 0, 1]]
b = [1, 3]
[[region]]
frame = "tip"
box_lower = [0, 0, 0]
box_upper = [1, 2, 3]
[[region]]
frame = "tip"
normal = [0, 0, 2]
offset = 1
[[contact]]
frame = "tip"
on = "block"
face = "-y"
touches = ["pad"]
[[held]]
body = "tray"
frame = "tip"
position = [0, 0, 0.1]
[options]
moving = ["a"]
touching = [["pad", "block"]]
start = {a = 0.5, b = [1, 0, 0, 0]}
max_step = 0.3
margin = 0.01
form = "rotation"
closest = true
""",
    )
    posed, pointing = found.goals
    np.testing.assert_allclose(posed.rotation, np.diag([1.0, -1.0, -1.0]), atol=1e-12)
    assert pointing.within == pytest.approx(np.pi / 2) and pointing.position is None
    np.testing.assert_allclose(pointing.axis, [1, 0, 0])
    half, box, plane = found.regions
    np.testing.assert_allclose(half.b, [0.5, 3.0])
    np.testing.assert_allclose(box.b, [1, 2, 3, 0, 0, 0])
    assert plane.equal.all() and plane.b == pytest.approx(0.5)
    assert found.contacts[0].face == "-y" and found.contacts[0].touches == ("pad",)
    np.testing.assert_allclose(found.held[0].T_frame_body.position, [0, 0, 0.1])
    assert found.moving == ("a",) and found.touching == (("pad", "block"),)
    assert found.start == {"a": (0.5,), "b": (1.0, 0.0, 0.0, 0.0)}
    assert (found.max_step, found.margin, found.form, found.closest) == (0.3, 0.01, "rotation", True)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "goal is missing"),
        (GOAL + "[[gaol]]\n", "did you mean goal"),
        (GOAL + "positoin = [1]\n", "did you mean position"),
        ('[[goal]]\nframe = "tip"\n', "asks for nothing"),
        ("[[goal]]\nposition = [0, 0, 0]\n", "goal[0].frame is missing"),
        (GOAL.replace("[0.3, 0.0, 0.2]", "[0.3, 0.0]"), "goal[0].position has 2 numbers"),
        (GOAL.replace("0.3", "nan"), "goal[0].position is [nan"),
        (GOAL + "quat_wxyz = [1, 1, 0, 0]\n", "goal[0]: "),
        (GOAL + "quat_wxyz = [1, 0, 0, 0]\ndirection = [0, 0, 1]\n", "quat_wxyz and a direction"),
        (GOAL + "within_deg = 4\n", "goal[0].within_deg stands without direction"),
        (GOAL + "direction = [0, 0, 2]\n", "a direction has length 2"),
        (GOAL + "direction = [0, 0, 1]\nwithin_deg = 180\n", "a cone of"),
        ('[[region]]\nframe = "tip"\n', "region[0] says no region"),
        ('[[region]]\nframe = "tip"\nnormal = [0, 0, 1]\nbox_lower = [0, 0, 0]\n', "says 2 regions"),
        ('[[region]]\nframe = "tip"\nnormal = [0, 0, 1]\n', "region[0].offset is missing"),
        ('[[region]]\nframe = "tip"\nnormal = [0, 0, 0]\noffset = 1\n', "its normal is zero"),
        ('[[region]]\nframe = "tip"\nA = [[1, 0]]\nb = [1]\n', "rows of 3 numbers"),
        ('[[region]]\nframe = "tip"\nA = [[1, 0, 0]]\nb = [1, 2]\n', "A (k, 3) and b (k,)"),
        ('[[region]]\nframe = "tip"\nA = []\nb = []\n', "A (k, 3) and b (k,)"),
        ('[[region]]\nframe = "tip"\nbox_lower = [0, 2, 0]\nbox_upper = [1, 1, 1]\n', "is above box_upper"),
        ('[[contact]]\nframe = "tip"\non = "block"\nface = "+x"\ninset = -1\n', "contact[0].inset is -1"),
        (GOAL + "[options]\nmax_step = 0\n", "options.max_step is 0"),
        (GOAL + '[options]\nform = "cubic"\n', "quaternion or rotation"),
        (GOAL + '[options]\nclosest = "yes"\n', "true or false"),
        (GOAL + '[options]\ntouching = [["a"]]\n', "pairs of geoms"),
        (GOAL + "[options]\nstart = 3\n", "options.start is 3"),
        ("options = 3\n" + GOAL, "options must be a table"),
        ("goal = 3\n", "[[goal]]"),
        (GOAL + "[[goal\n", "not valid TOML"),
    ],
)
def test_what_makes_no_sense_is_named_with_file_and_key(tmp_path, text, says):
    with pytest.raises(WorkcellError, match=re.escape(says)) as refusal:
        read(tmp_path, text)
    assert "goals.toml" in str(refusal.value)


def test_a_file_of_something_else_is_refused(tmp_path):
    path = tmp_path / "goals.toml"
    for text, says in (
        ('format = "workcell-task/1"\n', "format is"),
        ("", "format is missing"),
    ):
        path.write_text(text)
        with pytest.raises(WorkcellError, match=says):
            read_goals(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(WorkcellError, match="not a text file"):
        read_goals(path)
    with pytest.raises(WorkcellError, match="can't read this file"):
        read_goals(tmp_path)


def test_a_contact_is_on_the_face_where_the_box_stands(tmp_path, mechanism):
    text = '[[contact]]\nframe = "tip"\non = "block"\nface = "{}"\ninset = 0.01\nlift = 0.02\n'
    # the block is turned by a quarter about z: its x is the world's y, its y the world's -x
    inside = {"+x": [0.4, 0.14, 0.0], "-y": [0.46, 0.1, 0.0], "+z": [0.4, 0.1, 0.08]}
    for face, point in inside.items():
        asked = read(tmp_path, text.format(face))
        problem = asked.problem(mechanism.compiled.model)
        (region,) = problem.regions
        over = region.A @ point - region.b
        assert abs(over[region.equal]).max() < 1e-9 and np.all(over[~region.equal] < -0.009)
        assert problem.touching == (("pad", "block"),)


@pytest.mark.parametrize(
    ("on", "says"),
    [
        ("ball", "is a sphere, not a box"),
        ("pad", "moves with the mechanism"),
        ("blok", "did you mean block"),
        ("arm", "has 0 boxes"),
    ],
)
def test_contacts_on_what_is_no_standing_box_are_refused(mechanism, on, says):
    with pytest.raises(WorkcellError, match=says):
        standing_box(mechanism, on, "here")


def test_geoms_of_a_frame_are_those_that_can_collide_on_its_body(mechanism):
    assert body_geoms(mechanism, "tip") == ("pad",) == body_geoms(mechanism, "hand")


def test_frames_faces_and_steps_are_checked_against_the_model(tmp_path, mechanism):
    model = mechanism.compiled.model
    contact = '[[contact]]\nframe = "tip"\non = "block"\nface = "+x"\n'
    for text, says in (
        (GOAL.replace("tip", "tap"), "did you mean tip"),
        (contact.replace("+x", "top"), "contact[0]: there is no face 'top'"),
        (contact + "inset = 1.0\n", "nothing is left of the face"),
        (contact + 'touches = ["pod"]\n', "did you mean pad"),
        (GOAL + '[options]\nmoving = ["c"]\n', "no joint named 'c'"),
        (GOAL + "[options]\nstart = {a = [1, 2]}\n", "takes 1 numbers"),
        (GOAL + "[options]\nstart = {c = 1}\n", "no joint named 'c'"),
    ):
        with pytest.raises(WorkcellError, match=re.escape(says)):
            read(tmp_path, text).problem(model)
    asked = read(tmp_path, GOAL + "[options]\nmax_step = 0.1\n").problem(model)
    np.testing.assert_allclose(asked.q_reference, asked.mechanism.home)
    assert read(tmp_path, GOAL).problem(model).q_reference is None


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_examples_are_such_files_and_say_how_they_are_asked(path):
    read_goals(path)
    assert f"--goals examples/{path.name}" in path.read_text()


def test_mechanisms_of_files_are_those_of_their_compiled_models(tmp_path, mechanism):
    model = compile_spec(load_spec(tmp_path / "model.xml"), tmp_path)
    assert [joint.name for joint in mechanism.joints] == [
        "a",
        "b",
    ] and mechanism.compiled.model.nq == model.nq


def test_what_the_document_shows_is_read_as_it_stands(tmp_path):
    text = (EXAMPLES[0].parents[1] / "docs" / "goals.md").read_text()
    whole, more = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    path = tmp_path / "goals.toml"
    path.write_text(whole)
    asked = read_goals(path)
    assert (len(asked.goals), len(asked.regions), asked.max_step) == (1, 1, 0.3)
    asked = read(tmp_path, more)
    assert (
        asked.contacts[0].touches == ("hand/rh_ffdistal_collision",) and asked.held[0].body == "crate/crate"
    )
