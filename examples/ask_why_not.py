"""Ask why a pose can't be reached: the proof, what is in the way, and the nearest pose that can be.

A block stands under a beam that leaves no room for a hand. `solve` ends in a proof, true of the real geometry;
`explain` decides the question again without this or that, and names the smallest thing whose absence would help.
"""

from workcell import Budget, PlanningWorld, Scene, explain, solve

scene = Scene.load("blocked")  # a task that travels with workcell: a UR10, a block, a beam
world = PlanningWorld.of(
    scene, overshoot=0.03, approached=["block"]
)  # metres that the spheres may exceed the arm by
problem = world.problem(scene.goal("grasp").pose)

result = solve(problem, seed=0)
print(f"{result.status.value}: {result.status.sentence}")
print(f"proof: {result.certificate.statement}")

why = explain(problem, result, budget=Budget(3.0))  # seconds of CPU time
print(f"why: {why.sentence}")
print(f"in the way: {', '.join(cause.name for cause in why.causes)}")
if why.closest is not None:
    print(f"nearest pose that was found: {1e3 * why.closest.position_error:.0f} mm off")
