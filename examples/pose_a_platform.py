"""A platform on six legs: six drives, six ball joints, six loops, asked at once; and a pose too far."""

from workcell import FrameGoal, MechanismWorld, Pose, closest_configuration, solve_mechanism

world = MechanismWorld.of("stewart")  # every joint of the cell, with the spheres that keep its legs apart
mechanism = world.mechanism
print(f"{len(mechanism.joints)} joints, {len(mechanism.closures)} loops")

question = world.problem([FrameGoal.posed("platform", Pose.from_xyz([0.5, 0.0, 0.9]))])
result = solve_mechanism(question, solver="ikspark")
q = result.unwrap()
legs = [float(q[mechanism.value_slices[mechanism.joint(f"leg{k}_slide")]][0]) for k in range(1, 7)]
print(f"{result.status.value}: legs {', '.join(f'{leg:.3f}' for leg in legs)} m")
print(f"loops hold within 1e-9 m, by MuJoCo's measure: {result.measured.closure_error < 1e-9}")

far = world.problem([FrameGoal.posed("platform", Pose.from_xyz([5.0, 0.0, 0.9]))])
no = solve_mechanism(far)
print(f"{no.status.value}: {no.certificate.statement}")
near = closest_configuration(far)
print(f"closest: cost {near.cost:.3f}, and none is below {near.bound:.3f}")
