"""Ask CIDGIK itself for what no pose says: where a tool is and where it points, clear of balls.

Its queries also take trees with a goal for every tool, planes, and pairs of points that keep apart.
"""

from workcell import Piece, PlanningWorld, Pose, Scene
from workcell.geometry.covers.outer import obstacle_cover
from workcell.ik.cidgik.query import check_query, solve_query
from workcell.ik.trees.query import Balls, Goal, Points, Query, Workspace

world = PlanningWorld.of(Scene.load("tracing", robot="ur10"))
arm, spheres = world.robot.robot, Points.of_cover(world.cover)  # these keep clear, not the joints alone
post = Piece("post", "cylinder", Pose.from_xyz([0.45, -0.1, 0.6]), [0.05, 0.4])
workspace = Workspace(spheres, Balls.of_cover(obstacle_cover([post], overshoot=0.03)))

# the tool's z axis points down; turning about it is free
down = Goal.pointing("tool", [0.7, 0.1, 0.4], [0.0, 0.0, -1.0])
answer = solve_query(Query(arm, (down,), workspace), seed=0)
print(
    f"{answer.status.value}: {1e3 * answer.verdict.clearance:.0f} mm clear, at {arm.fk(answer.q).position.round(4)}"
)

far = Query(arm, (Goal.at("tool", [1.2, 0.9, 0.9]),), workspace)
refused = solve_query(far, seed=0)
print(
    f"farther out: {refused.status.value}; the proof, checked again: {check_query(far, refused.proof) or 'it holds'}"
)
