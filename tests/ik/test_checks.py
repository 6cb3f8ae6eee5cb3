"""What an answer says of collisions is what was looked at: nothing to check is not clear."""

import numpy as np
import pytest

from workcell.geometry.types import Piece, SphereCover
from workcell.ik.problem import Budget, Checks, Clearance, IKProblem
from workcell.ik.result import Status
from workcell.ik.solve import solve
from workcell.model.loading.load import load_robot
from workcell.model.scene import Scene
from workcell.pose import Pose
from workcell.world.planning_world import PlanningWorld

ARM = load_robot("ur10")
Q = np.array([0.3, -1.2, 1.0, 0.4, 1.1, 0.2])
BALLS = (
    Piece("one", "sphere", Pose.from_xyz([0.3, 0.9, 0.9]), np.array([0.1])),
    Piece("two", "box", Pose.from_xyz([0.3, -0.9, 0.9]), np.array([0.1, 0.1, 0.1])),
)
BARE = """
<mujoco><worldbody><body name="base"><geom type="box" size=".05 .05 .05" contype="0" conaffinity="0"/>
<body name="l1" pos="0 0 .1"><joint name="j1" axis="0 0 1" range="-170 170"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" contype="0" conaffinity="0"/>
<body name="l2" pos=".3 0 0"><joint name="j2" axis="0 1 0" range="-120 120"/>
<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" contype="0" conaffinity="0"/><site name="tool" pos=".3 0 0"/>
</body></body></body></worldbody>
<actuator><motor name="m1" joint="j1"/><motor name="m2" joint="j2"/></actuator></mujoco>
"""
CELL = '<mujoco><worldbody><site name="robot_mount"/><geom name="post" size=".1" pos=".4 0 .1"/></worldbody></mujoco>'


def spheres(links: list[int]) -> SphereCover:
    return SphereCover(np.array(links, dtype=np.int64), np.zeros((len(links), 3)), np.full(len(links), 0.05))


def test_a_plain_problem_is_not_called_clear() -> None:
    result = solve(IKProblem(ARM, ARM.fk(Q)))
    assert result.solved and result.checks == Checks(asked=False)
    assert "clear" not in result.sentence and "clear" not in result.status.sentence
    assert result.sentence.endswith("It is not checked for collisions, which were not asked about.")
    assert np.isinf(result.clearance.distance) and result.clearance.pair == ("", "")


@pytest.mark.parametrize(
    ("cover", "obstacles", "pairs", "words"),
    [
        (
            spheres([]),
            BALLS,
            None,
            "not checked for collisions, as there is no collision geometry that could meet",
        ),
        (
            spheres([1, 6]),
            (),
            None,
            "not checked for collisions, as there is no collision geometry that could meet",
        ),
        (
            spheres([1, 6]),
            BALLS,
            None,
            "clear of obstacles (the robot's own parts were not checked against each other)",
        ),
        (spheres([1, 6]), BALLS, [[0, 1]], "clear of obstacles and of itself"),
        (spheres([1, 6]), (), [[0, 1]], "clear of itself (there is nothing else to meet)"),
    ],
)
def test_the_words_say_what_was_looked_at(cover, obstacles, pairs, words) -> None:
    own = None if pairs is None else np.array(pairs)
    problem = IKProblem(ARM, ARM.fk(Q), obstacles=obstacles, cover=cover, self_collision=own)
    result = solve(problem)
    assert result.solved and problem.checks.words == words and words in result.sentence


def test_a_checker_that_does_not_say_what_it_looks_at_is_named() -> None:
    result = solve(IKProblem(ARM, ARM.fk(Q), checker=lambda q: Clearance(0.5)))
    assert "clear, as the problem's own checker has it" in result.sentence


@pytest.mark.parametrize("solver", ["auto", "branch", "cidgik", "hjcd", "ikspark", "multistart"])
@pytest.mark.parametrize("links", [[], [0], [0, 1, 2], [3]])
def test_links_without_spheres_are_no_error(solver: str, links: list[int]) -> None:
    problem = IKProblem(ARM, ARM.fk(Q), obstacles=BALLS, cover=spheres(links))
    result = solve(problem, solver=solver, budget=Budget(2.0))
    assert result.status in (Status.SOLVED, Status.NOT_FOUND)
    assert not any("failed" in line for line in result.rejected)


def test_a_robot_without_collision_geometry_is_not_called_clear(tmp_path) -> None:
    (tmp_path / "bare.xml").write_text(BARE)
    (tmp_path / "cell.xml").write_text(CELL)
    world = PlanningWorld.of(Scene.load(tmp_path / "cell.xml", robot=str(tmp_path / "bare.xml")))
    result = solve(world.problem(world.robot.robot.fk(np.array([0.0, 0.2]))))
    assert result.solved and "clear" not in result.sentence
    assert "no collision geometry that could meet" in result.sentence


@pytest.mark.parametrize("name", ["sawyer", "iiwa14"])
def test_the_world_of_a_robot_alone_looks_at_the_robot_itself(name: str) -> None:
    world = PlanningWorld.of(name)
    assert not world.obstacles and world.clearance.checks.itself > 0 and world.clearance.checks.obstacles == 0
    rng, touching = np.random.default_rng(0), 0
    for q in world.robot.robot.random_configuration(rng, 30):
        result = solve(world.problem(world.robot.robot.fk(q)), budget=Budget(1.0))
        if result.solved:
            assert world.clearance(result.unwrap()).distance >= 0
            assert "clear of itself" in result.sentence
        touching += world.clearance(q).distance < 0
    assert touching > 0


def test_the_world_of_a_file_alone(tmp_path) -> None:
    (tmp_path / "bare.xml").write_text(BARE)
    assert PlanningWorld.of(tmp_path / "bare.xml").clearance.checks.nothing
    assert PlanningWorld.of(str(tmp_path / "bare.xml")).robot.name == "bare"
