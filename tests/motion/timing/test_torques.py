"""Inverse dynamics: Pinocchio's chain against MuJoCo, and against Pinocchio's own reading of the MJCF file."""

import numpy as np
import pytest

from workcell.errors import InputError
from workcell.model.loading.assets import find_asset
from workcell.model.scene import robot_scene
from workcell.motion.path import Trajectory, stationary
from workcell.motion.timing.torques import ChainDynamics


@pytest.fixture(scope="module")
def scene():
    return robot_scene("sawyer")


@pytest.fixture(scope="module")
def motion(scene):
    rng = np.random.default_rng(0)
    q = scene.robot().robot.random_configuration(rng, 25)
    return Trajectory(
        "sawyer", 0.002 * np.arange(25), q, rng.normal(size=q.shape), 3 * rng.normal(size=q.shape)
    )


def test_equals_mujoco(scene, motion):
    import mujoco

    data = mujoco.MjData(scene.model)
    model = scene.model
    torques = ChainDynamics(scene).at(motion.q, motion.qd, motion.qdd)
    for k in range(len(motion)):
        data.qpos[:], data.qvel[:], data.qacc[:] = motion.q[k], motion.qd[k], motion.qdd[k]
        mujoco.mj_inverse(model, data)
        free = data.qfrc_inverse + data.qfrc_constraint  # random configurations touch themselves
        assert np.allclose(free, torques[k], atol=1e-9)


def test_equals_pinocchios_own_reading_of_the_file(scene, motion):
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromMJCF(str(find_asset("robots", "sawyer")))
    data = model.createData()
    torques = ChainDynamics(scene).at(motion.q, motion.qd, motion.qdd)
    for k in range(len(motion)):
        own = pinocchio.rnea(model, data, motion.q[k], motion.qd[k], motion.qdd[k])
        assert np.allclose(own + model.damping * motion.qd[k], torques[k], atol=1e-9)


def test_use_against_effort_limits(scene):
    chain = scene.robot().robot
    dynamics = ChainDynamics(scene)
    at_rest = dynamics.use(stationary("sawyer", chain.home, 0.02))
    assert at_rest.kept and at_rest.joint == chain.joint_names[int(np.argmax(at_rest.share))]
    n = 6
    q = np.tile(chain.home, (n, 1))
    hard = Trajectory("sawyer", 0.002 * np.arange(n), q, 0 * q, np.full_like(q, 200.0))
    assert not dynamics.use(hard, every=1).kept
    # the last sample counts, however few there are
    assert dynamics.use(stationary("sawyer", chain.home, 0.002)).share == pytest.approx(at_rest.share)
    late = Trajectory("sawyer", hard.time, q, 0 * q, np.where(np.arange(n)[:, None] == n - 1, 200.0, 0.0 * q))
    assert dynamics.use(late, every=4).worst == n - 1
    with pytest.raises(InputError, match="moves 3 joints"):
        dynamics.use(stationary("x", [0, 0, 0], 0.1))
