"""Put obstacles around an arm in Python: convex pieces in the world, and the arm as spheres that hold it.

Where no MuJoCo model knows the obstacles, an exact kernel on spheres and pieces is the judge.
"""

from workcell import IKProblem, Piece, PlanningWorld, Pose, Scene, Tolerances, solve, verify

world = PlanningWorld.of(
    Scene.load("tracing", robot="ur10"), overshoot=0.02
)  # for the arm's spheres, 2 cm too large
target = Pose([0.7, 0.1, 0.4], [0.0, 1.0, 0.0, 0.0])  # metres; quaternion w, x, y, z
wall = Piece("wall", "box", Pose.from_xyz([0.45, 0.1, 0.22]), [0.02, 0.3, 0.22])  # half sizes in metres
post = Piece("post", "cylinder", Pose.from_xyz([0.6, 0.35, 0.5]), [0.05, 0.5])  # radius, half length along z
block = Piece("block", "box", Pose.from_xyz([0.7, 0.1, 0.45]), [0.1, 0.1, 0.1])  # where the hand has to be


def among(*obstacles: Piece) -> IKProblem:
    """The question with these obstacles, 5 mm clear of each."""
    keep = Tolerances(safety_margin=0.005)
    return IKProblem(world.robot.robot, target, obstacles=obstacles, cover=world.cover, tolerances=keep)


result = solve(among(wall, post), seed=0)
print(f"a wall and a post: {result.status.value}, {1e3 * result.clearance.distance:.1f} mm clear")

blocked = solve(among(wall, post, block), seed=0)
print(
    f"a block as well: {blocked.status.value}"
)  # of the model: the spheres are a little larger than the arm
print(f"proof: {blocked.certificate.statement}")

verdict = verify(among(wall, post, block), result.q)
print(f"the configuration from before is refused: {'; '.join(verdict.reasons)}")
