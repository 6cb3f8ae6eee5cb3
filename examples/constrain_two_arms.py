"""Two arms hold one crate, a closed chain, under a constraint of the user's own, written in cvxpy."""

import cvxpy as cp
import numpy as np

from workcell import FrameGoal, Held, MechanismWorld, Pose, Scene, UserConstraint, solve_mechanism
from workcell.model.mechanism.placing import place

scene = Scene.load("dual_arm_carry")
moving = [f"{side}/joint{k}" for side in ("left", "right") for k in range(1, 8)]
held = [
    Held(
        "crate/crate", f"{side}/gripper/tool", Pose(np.array([0.0, y, 0.115]), np.array([0.0, 1.0, 0.0, 0.0]))
    )
    for side, y in (("left", 0.205), ("right", -0.205))
]
world = MechanismWorld.of(scene, moving=moving, held=held)


def elbows_together(mechanism):
    """The elbows stay within 0.9 m of each other, and the left one at or below 0.6 m."""
    left, right = mechanism.point("left/link4"), mechanism.point("right/link4")
    return [cp.norm(left - right) <= 0.9, left[2] <= 0.6]


question = world.problem(
    [FrameGoal.pointing("crate/crate", [0.0, 0.0, 1.0], position=[0.55, 0.0, 0.3], within=0.05)],
    constraints=[UserConstraint("elbows", elbows_together)],
)
result = solve_mechanism(question)
print(f"{result.status.value} by {result.solver}, {result.measured.looked_at} pairs of geoms looked at")
print(f"both hands hold the crate within 1e-9 m: {result.measured.closure_error < 1e-9}")
places = place(world.mechanism, result.unwrap())
left, right = (places.p[world.mechanism.frame(f"{side}/link4").link] for side in ("left", "right"))
print(
    f"the elbows are within 0.9 m: {np.linalg.norm(left - right) <= 0.9}, the left one low: {left[2] <= 0.6}"
)
