"""The terms that a step reports are the paper's (Eqs. 4 to 7), by plain numpy, along the steps that were made."""

import numpy as np
import pytest

from tests.motion.live.reference import chis, collision, displacement, groove, objective
from workcell.bench.live.arms import SETUPS, arms_of, rest_rotation
from workcell.bench.live.traces import PERIOD, trace
from workcell.motion.live.live_ik import LiveIK
from workcell.motion.live.weights import WEIGHTS_A

HUBO = next(setup for setup in SETUPS if setup.robot == "hubo_arm")


def test_the_groove_is_a_well_and_the_reference_agrees_with_the_paper():
    assert groove(0.0) == pytest.approx(-1.0) and groove(0.0, n=0) == pytest.approx(1.0)
    chi = np.linspace(0.0, 1.0, 50)
    assert np.all(np.diff(groove(chi)) > 0.0)
    turned = np.array([np.cos(0.35), 0.0, np.sin(0.35), 0.0])
    assert displacement(-turned, np.array([1.0, 0.0, 0.0, 0.0])) == pytest.approx(0.7)
    assert collision([0.0, 0.3, 0.1], [0.2, 0.3, 0.0]) == pytest.approx(50.0)


def test_terms_are_those_of_the_steps_that_were_made():
    arms = arms_of(HUBO)
    robot, path = arms.robots[0], trace("spoon feeding", HUBO, rest_rotation(arms.robots[0]))
    live = LiveIK(arms.worlds(), period=PERIOD)
    made = [live.q] * 3
    for k in range(60):
        goal = path.goals(k)[0]
        step = live.step({arms.names[0]: goal})
        told = chis(robot, step.q, made[-1:-4:-1], goal)
        assert step.terms[:6] == pytest.approx(told, abs=1e-7), k
        assert step.position_error[0] == pytest.approx(told[0], abs=1e-7)
        assert step.rotation_error[0] == pytest.approx(told[1], abs=1e-7)
        made.append(np.array(step.q))
    # the sum falls while the arm comes to its path
    still = objective(robot, made[0], made[:1] * 3, path.goals(59)[0], WEIGHTS_A.array)
    assert objective(robot, made[-1], made[-2:-5:-1], path.goals(59)[0], WEIGHTS_A.array) < still
