"""Joints that nothing drives are where the ties have them."""

import numpy as np
import pytest

from tests.simulate.mechanisms.crank import write_task
from workcell.errors import InputError, ModelError, UnknownNameError
from workcell.model.mechanism.following import approach, close, given_joints, given_rates
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.placing import missed, place
from workcell.model.scene import Scene


@pytest.fixture
def crank(tmp_path):
    return Scene.load(write_task(tmp_path)).mechanism.mechanism


def test_a_rod_is_where_its_closed_form_says(crank):
    assert [crank.joints[k].name for k in given_joints(crank)] == ["motor"]
    for angle in np.linspace(-1.2, 1.2, 7):
        found = approach(crank, crank.home, crank.configuration({"motor": angle}))
        assert found.is_closed and not found.yielded
        x = 0.1 * np.cos(angle) + np.sqrt(0.3**2 - (0.1 * np.sin(angle)) ** 2)
        assert found.q[crank.value_slices[crank.joint("rail")].start] == pytest.approx(x - 0.4, abs=1e-9)
        assert np.abs(missed(place(crank, found.q))[0]).max() < 1e-9


def test_where_motors_contradict_each_other_all_of_them_yield(crank):
    everything = np.ones(crank.dof, dtype=bool)
    astray = crank.home + np.array([0.3, 0.1, 0.02])
    found = close(crank, astray, everything)
    assert found.yielded and found.is_closed
    assert np.abs(found.q - astray).max() < 0.3


def test_a_loop_that_is_too_long_is_not_closed(crank):
    far = crank.configuration({"motor": 0.0, "rail": 0.5})
    held = given_rates(crank) | (np.arange(crank.dof) == crank.rate_slices[crank.joint("rail")].start)
    found = close(crank, far, held)
    assert found.yielded  # only by letting the given joints go


def test_a_task_says_where_its_mechanism_begins(tmp_path):
    scene = Scene.load(write_task(tmp_path, start="start = {motor = 0.8}"))
    moving = scene.mechanism
    assert not scene.robots and moving.motor_names == ("motor",) and moving.frames == ("block",)
    assert moving.motor_values(moving.start) == pytest.approx([0.8])
    assert moving.velocity == pytest.approx([3.0]) and moving.acceleration == pytest.approx([15.0])
    assert np.abs(missed(place(moving.mechanism, moving.start))[0]).max() < 1e-9
    assert scene.initial_qpos()[moving.motor_addresses] == pytest.approx([0.8])
    assert scene.obstacles == ("wall",)
    named = {scene.model.body(body).name for body in moving.body_ids}
    assert named == {"crank", "rod", "slider"}


@pytest.mark.parametrize(
    ("line", "error", "words"),
    [
        ("start = {moto = 0.8}", UnknownNameError, "moto"),
        ("start = {motor = [0.8, 1.0]}", InputError, "1 number"),
        ("start = 3", ModelError, "start"),
        ('frame = ["block"]', UnknownNameError, "frame"),
        ('joints = ["motor", "elbo"]', UnknownNameError, "elbo"),
        ('joints = "motor"', ModelError, "strings"),
    ],
)
def test_what_a_task_says_wrongly_is_named(tmp_path, line, error, words):
    with pytest.raises(error, match=words) as caught:
        Scene.load(write_task(tmp_path, start=line))
    assert "crank.toml" in str(caught.value)


def test_a_frame_that_is_not_there_and_robots_beside_it_are_refused(tmp_path):
    path = write_task(tmp_path)
    text = path.read_text()
    path.write_text(text.replace('frames = ["block"]', 'frames = ["blok"]'))
    with pytest.raises(UnknownNameError, match="blok"):
        Scene.load(path)
    path.write_text(text + '\n[[robots]]\nname = "arm"\nmodel = "iiwa14"\n')
    with pytest.raises(ModelError, match="beside robots"):
        Scene.load(path)


def test_ball_joints_without_drives_are_found_from_the_legs_of_a_platform():
    import mujoco

    from workcell.model.loading.assets import find_asset

    model = mujoco.MjModel.from_xml_path(str(find_asset("cells", "stewart")))
    platform = mechanism_of(model)
    lifted, free = np.array(platform.home), platform.rate_slices[platform.joint("platform")]
    lifted[platform.value_slices[platform.joint("platform")].start + 2] += 0.05
    given = np.zeros(platform.dof, dtype=bool)
    given[free] = True
    found = close(platform, lifted, given)
    assert found.is_closed and not found.yielded
    data = mujoco.MjData(model)
    data.qpos[:] = platform.compiled.qpos(found.q)
    mujoco.mj_fwdPosition(model, data)
    equal = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    assert np.abs(data.efc_pos[equal]).max() < 1e-6
