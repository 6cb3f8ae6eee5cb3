"""Two robots in one scene: both are controlled, both are watched, and what they hold together is shared."""

import numpy as np
import pytest

from tests.simulate.test_shared_load import constraint_force
from tests.simulate.test_simulation import quintic
from workcell.errors import InputError, UnknownNameError
from workcell.model.loading.assets import find_task
from workcell.model.scene import Scene
from workcell.pose import Pose
from workcell.simulate.execution import StopReason
from workcell.simulate.shared_load import internal_force, weld_force
from workcell.simulate.simulation import Simulation
from workcell.task.run import run_task


@pytest.fixture(scope="module")
def scene():
    return Scene.load("dual_arm_carry")


def test_both_hold_their_place_and_one_moves_alone(scene):
    simulation = Simulation(scene)
    start = scene.robot("right").start
    assert simulation.execute(quintic("right", start, start + 0.1, 0.3))
    result = simulation.result()
    assert result.q.shape[1] == 14 and result.tool_position.shape[1] == 6
    assert np.abs(result.q[:, :7] - scene.robot("left").start).max() < 1e-4
    assert np.abs(simulation.arm("right").reference - start - 0.1).max() < 1e-12
    assert result.max_tracking_error_m < 5e-4
    with pytest.raises(InputError, match="there are 2 robots: name one"):
        simulation.arm()
    with pytest.raises(UnknownNameError, match="robot named 'middle'"):
        simulation.execute(quintic("middle", start, start, 0.1))


def test_two_trajectories_at_once_may_differ_in_length(scene):
    simulation = Simulation(scene, "left")
    starts = [scene.robot(name).start for name in ("left", "right")]
    assert simulation.execute(
        [
            quintic("left", starts[0], starts[0] + 0.05, 0.2),
            quintic("right", starts[1], starts[1] - 0.05, 0.3),
        ]
    )
    assert simulation.time == pytest.approx(0.3)
    assert np.allclose(simulation.q_reference, starts[0] + 0.05)


def test_arms_that_meet_stop_the_run(scene):
    simulation = Simulation(scene, "left")
    inwards = [
        quintic(name, scene.robot(name).start, scene.robot(name).start + sign * 1.2 * np.eye(7)[0], 1.5)
        for name, sign in (("left", -1), ("right", 1))
    ]
    assert not simulation.execute(inwards)
    assert simulation.stop.reason is StopReason.CONTACT
    pair = simulation.result().contacts[0].pair
    assert {name.split("/")[0] for name in pair} == {"left", "right"}


def test_what_two_hands_hold_in_the_air_weighs_what_it_weighs(scene):
    """The forces of the two welds add up to the weight, in closed form; each controller carries half of it."""
    high = scene.moved({"crate": Pose.from_xyz([0.42, 0.0, 0.35])})
    simulation = Simulation(high, "left")
    assert simulation.attach("crate", "left") and simulation.attach("crate", "right")
    assert simulation.hold(0.8)
    held = [simulation.holding(name).weld for name in ("left", "right")]
    total = sum(weld_force(simulation.data, weld) for weld in held)
    mass = scene.model.body_subtreemass[scene.object("crate").body_id]
    assert total == pytest.approx([0, 0, 9.81 * mass], abs=0.02)
    left, right = (constraint_force(simulation.model, simulation.data, weld) for weld in held)
    strain = np.linalg.norm(left - right) / 2
    assert internal_force(simulation.data, held) == pytest.approx(strain, rel=1e-9)
    assert strain < 1.0
    result = simulation.result()
    assert result.internal_force[-1] == pytest.approx(strain, abs=0.2)
    assert result.max_tracking_error_m < 1e-3


def test_hands_that_pull_apart_strain_the_crate(scene):
    high = scene.moved({"crate": Pose.from_xyz([0.42, 0.0, 0.35])})
    simulation = Simulation(high, "left")
    simulation.attach("crate", "left")
    simulation.attach("crate", "right")
    simulation.hold(0.3)
    calm = simulation.result().internal_force[-1]
    start = scene.robot("left").start
    simulation.execute(quintic("left", start, start + 0.01 * np.eye(7)[0], 0.3))
    assert simulation.result().internal_force[-1] > calm + 5.0


def test_robots_that_overlap_at_the_start_are_refused_by_name(tmp_path):
    source = find_task("dual_arm_carry")
    (tmp_path / "both.toml").write_text(source.read_text().replace('"right_mount"', '"left_mount"'))
    (tmp_path / "both.py").write_text(source.with_suffix(".py").read_text())
    with pytest.raises(InputError, match=r"the start is in collision: .*left/.* and right/.* overlap by"):
        run_task(tmp_path / "both.toml", out=tmp_path / "out", say=lambda _: None)
    assert not (tmp_path / "out").exists()
