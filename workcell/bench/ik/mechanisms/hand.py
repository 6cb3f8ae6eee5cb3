"""Section X-D of IKSPARK: a hand of 24 joints puts five fingers on assigned faces of a cube.

The paper states neither the assignment nor any dimension. Ours is the cell `hand_cube`. A contact is the centre of the
ball in which a finger ends, a radius over its face, 6 mm inside its edges or more, with the fingertip's other end over
the face as well and its pad towards the face within a radian. There are two assignments: thumb, first to ring finger
opposite, each in its own third of the face, and the little finger on the side; and the thumb with all four fingers
opposite, anywhere on the face, where fingers have to stand in two rows and easily cross. The cube's edge, place and yaw
are drawn; nobody knows beforehand whether there is a grasp.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from workcell import clock
from workcell.bench.ik.mechanisms.answers import answers, mean, mechanism_row, worst
from workcell.bench.rows import Bench, Row
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.problem import MechanismProblem
from workcell.ik.mechanisms.result import MechanismResult
from workcell.ik.problem import Budget
from workcell.model.loading.load import compile_spec, load_spec
from workcell.pose import Pose, axis_angle_to_matrix
from workcell.world.mechanism_world import MechanismWorld

CELL, CUBE, PREFIX = "hand_cube", "cube", "hand/"
BUDGET = Budget(2.0)
"""CPU seconds of solving a grasp."""
OVERSHOOT = 0.006
"""Metres, of the spheres that stand for the hand."""
HALF = (0.025, 0.030)
"""Metres, half of the cube's edge."""
SHIFT = (0.006, 0.006, 0.004)
"""Metres by which the cube is shifted, either way."""
YAW = 0.1
"""Radians by which it is turned, either way."""
INSET, LEAN = 0.006, 1.0
"""Metres that contacts keep from edges; radians by which a pad may lean away."""
PAPER_BUILD_S, PAPER_SOLVE_S = 15.78, 3.16
METHODS = ("ikspark", "multistart", "auto")


FINGERS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {**dict.fromkeys(("ff", "mf", "rf", "lf"), (0.0078, 0.0122)), "th": (0.0095, 0.0130)}
)
"""Radius of the ball in which a finger ends, and length of the capsule that ends there, metres."""
OPPOSITE = {"ff": "+x", "mf": "+x", "rf": "+x", "th": "-x"}


@dataclass(frozen=True, slots=True)
class Assignment:
    """The face of each finger, and fingers that share a face in equal parts along the cube's y, from the top of it."""

    name: str
    faces: Mapping[str, str]
    parts: tuple[str, ...] = ()


ASSIGNMENTS = (
    Assignment("three opposite", {**OPPOSITE, "lf": "-y"}, ("ff", "mf", "rf")),
    Assignment("four opposite", {**OPPOSITE, "lf": "+x"}),
)


@dataclass(frozen=True, slots=True)
class Cube:
    """Half of a cube's edge (metres), and where it is."""

    half: float
    T_world_cube: Pose


def cubes(n: int, seed: int) -> list[Cube]:
    """Cubes around where the cell has its own, which is the first."""
    rng = np.random.default_rng(seed)
    place = np.array([0.0, 0.0, 0.1475])
    found = [Cube(0.0275, Pose(place, np.array([1.0, 0.0, 0.0, 0.0])))]
    while len(found) < n:
        half, shift, yaw = rng.uniform(*HALF), rng.uniform(-np.array(SHIFT), SHIFT), rng.uniform(-YAW, YAW)
        R = axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), yaw)
        found.append(Cube(float(half), Pose.from_rotation(place + shift, R)))
    return found[:n]


def grasp(cube: Cube, assignment: Assignment = ASSIGNMENTS[0]) -> MechanismProblem:
    """The question how the hand holds a cube, with the hand's spheres and what they may hit."""
    spec = load_spec(CELL, kind="cells")
    spec.geom(CUBE).size = [cube.half] * 3
    body = spec.body(CUBE)
    body.pos, body.quat = cube.T_world_cube.position, cube.T_world_cube.quat_wxyz
    model = compile_spec(spec, CELL)
    joints = [str(model.joint(j).name) for j in range(model.njnt)]
    world = MechanismWorld.of(
        model,
        moving=[name for name in joints if name.startswith(PREFIX)],
        touching=contacts(),
        overshoot=OVERSHOOT,
    )
    goals, regions = [], []
    for name, (radius, length) in FINGERS.items():
        ball, half = f"{PREFIX}{name}_ball", np.full(3, cube.half)
        face = assignment.faces[name]
        region = InRegion.on_face(ball, cube.T_world_cube, half, face, inset=INSET, lift=radius)
        inner = InRegion.polytope(ball, -region.A[:1], -region.b[:1], (0.0, 0.0, -length))
        regions += [region, inner]
        goals.append(FrameGoal.pointing(f"{PREFIX}{name}_tip", -region.A[0], within=LEAN))
    regions += [_part(cube, assignment, k) for k in range(len(assignment.parts))]
    return world.problem(goals, regions, q_reference=world.mechanism.home)


def _part(cube: Cube, assignment: Assignment, k: int) -> InRegion:
    """The part of a face that belongs to one of the fingers that share it."""
    y, edge = cube.T_world_cube.rotation[:, 1], cube.half - INSET
    width, middle = 2.0 * edge / len(assignment.parts), float(y @ cube.T_world_cube.position)
    upper = edge - k * width
    ends = np.array([middle + upper, width - upper - middle])
    return InRegion.polytope(f"{PREFIX}{assignment.parts[k]}_ball", np.array([y, -y]), ends)


def contacts() -> list[tuple[str, str]]:
    """Pairs of geoms that are to touch, and nothing else."""
    return [(f"{PREFIX}rh_{name}distal_collision", CUBE) for name in FINGERS]


def hand(n: int, seed: int, sets: Path | None = None) -> list[Row]:
    """A row for each assignment and method on n cubes; what building takes stands beside what solving does."""
    drawn = cubes(n, seed)
    grasp(drawn[0])  # imports and compiles what is loaded lazily
    rows = []
    for assignment in ASSIGNMENTS:
        problems, build_s = [], []
        for cube in drawn:
            began = clock.cpu_seconds()
            problems.append(grasp(cube, assignment))
            build_s.append(clock.cpu_seconds() - began)
        rows += [
            _row(f"{assignment.name}/{method}", problems, build_s, answers(problems, method, BUDGET, seed))
            for method in METHODS
        ]
    return rows


def _row(
    name: str,
    problems: Sequence[MechanismProblem],
    build_s: Sequence[float],
    results: Sequence[MechanismResult],
) -> Row:
    solved = [(p, r, b) for p, r, b in zip(problems, results, build_s, strict=True) if r.solved]
    measured = [result.measured for _, result, _ in solved if result.measured is not None]
    theirs = name.endswith("ikspark")
    extra = {
        "build_ms_mean": 1e3 * float(np.mean(build_s)),
        "total_ms_solved_mean": mean([1e3 * (b + float(r.stats["cpu_s"])) for _, r, b in solved]),
        "contact_gap_max": worst([_gap(problem, result) for problem, result, _ in solved]),
        "clearance_min": min((one.clearance.distance for one in measured), default=None),
        "region_error_max": worst([one.region_error for one in measured]),
        "paper_build_s": PAPER_BUILD_S if theirs else None,
        "paper_solve_s": PAPER_SOLVE_S if theirs else None,
    }
    return mechanism_row(f"{CELL}/{name}", results, extra=extra)


def _gap(problem: MechanismProblem, result: MechanismResult) -> float:
    """The largest distance (metres), or depth, of a pair of geoms that is to touch, by MuJoCo."""
    import mujoco

    compiled = problem.mechanism.compiled
    assert compiled is not None and result.q is not None
    model, data = compiled.model, mujoco.MjData(compiled.model)
    data.qpos[:] = compiled.qpos(result.q)
    mujoco.mj_kinematics(model, data)
    ids = [(model.geom(one).id, model.geom(two).id) for one, two in contacts()]
    return max(abs(float(mujoco.mj_geomDistance(model, data, one, two, 1.0, None))) for one, two in ids)


BENCHES = (
    Bench(
        "ikspark-hand",
        20,
        "a hand of 24 joints grasps cubes by assigned faces, nothing else touching (IKSPARK, section X-D)",
        hand,
    ),
)
