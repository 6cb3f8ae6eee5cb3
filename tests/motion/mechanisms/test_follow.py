"""Ways of mechanisms: waypoint by waypoint, halved where steps are too large, closed between waypoints."""

import numpy as np
import pytest

from tests.simulate.mechanisms.crank import write_task
from workcell.errors import InputError
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import Measured, MechanismResult
from workcell.ik.problem import Clearance
from workcell.ik.result import Status
from workcell.model.mechanism.following import approach
from workcell.model.mechanism.placing import missed, place
from workcell.model.scene import Scene
from workcell.motion.mechanisms.follow import FrameWaypoint, MechanismSteps, follow_mechanism
from workcell.motion.mechanisms.looking import look_along
from workcell.motion.mechanisms.path import MechanismPath, tangents
from workcell.motion.mechanisms.timing import MotionLimits, time_mechanism


@pytest.fixture
def scene(tmp_path):
    return Scene.load(write_task(tmp_path, start="start = {motor = 0.4}"))


def in_closed_form(problem):
    """The crank's angle for the block's place, and the rest by the ties; nothing beyond the bounds on a step."""
    mechanism, x = problem.mechanism, problem.goals[0].position[0]
    cosine = (0.1**2 + x**2 - 0.3**2) / (2 * 0.1 * x)
    if abs(cosine) > 1:
        return MechanismResult(Status.NOT_FOUND, "closed form", rejected=("too far",))
    q = np.array(problem.q_reference)
    q[0] = np.arccos(cosine)
    found = approach(mechanism, problem.q_reference, q)
    step = tangents(mechanism, np.array([problem.q_reference, found.q]))[0]
    if np.any(np.abs(step) > problem.max_step):
        return MechanismResult(Status.NOT_FOUND, "closed form", rejected=("too large a step",))
    return MechanismResult(Status.SOLVED, "closed form", found.q)


def block_at(x):
    return FrameWaypoint((FrameGoal.at("block", [x, 0.0, 0.3]),))


def test_steps_that_are_too_large_are_halved(scene):
    moving = scene.mechanism
    template = MechanismProblem(moving.mechanism)
    steps = MechanismSteps(0.15, None)
    way = [block_at(x) for x in (0.37, 0.34, 0.30)]
    result = follow_mechanism(template, way, moving.start, in_closed_form, steps=steps)
    assert result.followed and result.by == {"closed form": len(result.path) - 1}
    assert result.solved > len(way) and len(result.path) > len(way)
    assert np.abs(result.path.steps).max() <= 0.15 + 1e-12
    assert result.path.end[0] == pytest.approx(np.arccos((0.01 + 0.09 - 0.09) / (0.2 * 0.3)))
    assert result.path.largest_step <= 0.15 and result.path.largest_link_rotation > 0.0


def test_a_way_ends_with_the_waypoint_and_the_reason(scene):
    moving = scene.mechanism
    way = [block_at(0.37), block_at(0.45)]
    result = follow_mechanism(MechanismProblem(moving.mechanism), way, moving.start, in_closed_form)
    assert not result.followed and result.status is Status.NOT_FOUND
    assert "waypoint 2 of 2" in result.failure and "too" in result.failure
    assert result.path is not None and len(result.path) >= 2
    with pytest.raises(InputError, match="at least one"):
        follow_mechanism(MechanismProblem(moving.mechanism), [], moving.start, in_closed_form)


def test_what_is_asked_halfway(scene):
    a = FrameWaypoint((FrameGoal.turned("block", [1, 0, 0, 0]),))
    b = FrameWaypoint((FrameGoal.turned("block", [np.cos(0.4), 0, np.sin(0.4), 0]),))
    middle = a.halfway(b).goals[0].rotation
    expected = FrameGoal.turned("block", [np.cos(0.2), 0, np.sin(0.2), 0]).rotation
    assert middle == pytest.approx(expected, abs=1e-12)
    high, low = (FrameWaypoint(regions=(InRegion.plane("block", [0, 0, 1.0], z),)) for z in (0.5, 0.3))
    assert high.halfway(low).regions[0].b == pytest.approx([0.4])
    aside = FrameWaypoint(regions=(InRegion.plane("block", [1.0, 0, 0], 0.3),))
    assert high.halfway(aside) is None and a.halfway(high) is None
    pointing = [
        FrameWaypoint((FrameGoal.pointing("block", d),)) for d in ([1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0])
    ]
    assert pointing[0].halfway(pointing[1]).goals[0].direction == pytest.approx([0.5**0.5, 0.5**0.5, 0])
    assert pointing[0].halfway(pointing[2]) is None


def turning(moving, angles):
    rows = [
        approach(moving.mechanism, moving.start, moving.mechanism.configuration({"motor": a})).q
        for a in angles
    ]
    return MechanismPath(moving.mechanism, np.array(rows))


def test_between_waypoints_the_ties_hold_and_motors_go_straight(scene):
    path = turning(scene.mechanism, [0.4, 0.9])
    for share in (0.0, 0.3, 1.0):
        found = path.at(0, share)
        assert found.is_closed and found.q[0] == pytest.approx(0.4 + 0.5 * share)
    assert (path.reversed().start == path.end).all() and len(path + path.reversed()) == 3
    with pytest.raises(InputError, match="begins"):
        path + path
    with pytest.raises(InputError, match="two or more"):
        MechanismPath(path.mechanism, path.configurations[:1])


def test_a_motion_keeps_the_limits_of_motors_and_frames(scene):
    moving = scene.mechanism
    path = turning(moving, np.linspace(0.4, 1.4, 6))
    for speed, velocity in ((np.inf, 3.0), (0.05, 3.0), (np.inf, 0.5)):
        limits = MotionLimits(velocity, 10.0, {} if np.isinf(speed) else {"block": speed})
        motion = time_mechanism(path, limits, 0.002)
        rates, bends = motion.rates()
        assert np.abs(rates[:, 0]).max() <= velocity and np.abs(bends[:, 0]).max() <= 10.0
        block = np.diff(motion.q[:, 2]) / motion.dt
        assert np.abs(block).max() <= speed * 1.001
        assert max(np.abs(rates[:, 0]).max() / velocity, np.abs(block).max() / speed) > 0.7
        assert motion.q[0] == pytest.approx(path.start) and motion.q[-1] == pytest.approx(path.end)
        errors = [np.abs(missed(place(moving.mechanism, q))[0]).max() for q in motion.q[::7]]
        assert max(errors) < 1e-6
        for q in path.configurations:  # every waypoint is on the way
            assert np.abs(motion.q - q).max(axis=1).min() < 0.01


def test_forces_slow_a_motion_down_and_too_little_of_them_is_named(scene):
    path = turning(scene.mechanism, np.linspace(0.4, 1.4, 6))
    limits = MotionLimits(3.0, 15.0, {})
    free = time_mechanism(path, limits, 0.002)

    def share(motion):
        return float(np.abs(motion.rates()[1][:, 0]).max()) / 5.0

    slow = time_mechanism(path, limits, 0.002, share=share)
    assert share(slow) <= 1.0 and slow.duration > free.duration
    with pytest.raises(InputError, match="however slow"):
        time_mechanism(path, limits, 0.002, share=lambda motion: 2.0)


@pytest.mark.parametrize("velocity", [0.0, -1.0, np.nan, np.inf, [1.0, 1.0]])
def test_limits_that_are_none_are_refused(scene, velocity):
    with pytest.raises(InputError, match="velocity"):
        time_mechanism(turning(scene.mechanism, [0.4, 0.9]), MotionLimits(velocity, 1.0, {}), 0.002)


def test_a_motion_is_looked_at_as_often_as_asked(scene):
    motion = time_mechanism(
        turning(scene.mechanism, np.linspace(0.4, 1.4, 6)), MotionLimits(3.0, 15.0, {}), 0.002
    )
    seen = []

    def measure(q):
        seen.append(q[0])
        beyond = ("beyond",) if q[0] > 1.2 else ()
        return Measured(closure_error=1e-9, clearance=Clearance(1.0 - q[0]), reasons=beyond)

    looked = look_along(motion, measure, 0.05)
    assert "beyond" in looked.reason and seen[-1] > 1.2 and np.all(np.array(seen[:-1]) <= 1.2)
    assert np.diff(seen).max() <= 0.05 + 1e-9 and looked.spacing <= 0.05 + 1e-9
    assert looked.clearance == pytest.approx(1.0 - seen[-1])
    clear = look_along(motion, lambda q: Measured(), 0.05)
    assert not clear.reason and clear.times[0] == 0.0 and clear.times[-1] == pytest.approx(motion.duration)
