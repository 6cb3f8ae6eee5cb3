"""Small arms with spheres, for the tests of the solvers and the judge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workcell.geometry.types import Piece, SphereCover
from workcell.ik.judge.exact import ExactDistances, ExactKinematics, smallest_clearance
from workcell.ik.problem import IKProblem
from workcell.model.robot import Robot, Tool
from workcell.pose import Array, Pose, axis_angle_to_matrix


def planar(lengths: tuple[float, ...] = (0.5, 0.4), limit: float = np.pi) -> Robot:
    """Revolute joints about z; link k is `lengths[k]` long, along x; the tool at the end of the last."""
    n = len(lengths)
    xyz = np.array([[0.0, 0.0, 0.0], *[[length, 0.0, 0.0] for length in lengths[:-1]]])
    return _robot(
        "planar", xyz, np.tile(np.eye(3), (n, 1, 1)), np.tile([0.0, 0, 1], (n, 1)), limit, [lengths[-1], 0, 0]
    )


def gantry(radius: float) -> tuple[Robot, SphereCover]:
    """A ball in the plane: two sliding joints of +-1.5 m."""
    robot = _robot(
        "gantry",
        np.zeros((2, 3)),
        np.tile(np.eye(3), (2, 1, 1)),
        np.eye(3)[:2],
        1.5,
        [0, 0, 0],
        np.ones(2, dtype=bool),
    )
    return robot, SphereCover(np.array([2]), np.zeros((1, 3)), np.array([radius]))


def seven() -> Robot:
    """A seven-joint arm: roll and pitch joints in turn, with offsets at the elbow."""
    xyz = np.array(
        [[0, 0, 0.3], [0, 0, 0.1], [0, 0.05, 0.3], [0, 0, 0.1], [0.05, 0, 0.3], [0, 0, 0.08], [0, 0.03, 0.1]]
    )
    axes = np.array([[0.0, 0, 1] if k % 2 == 0 else [0.0, 1, 0] for k in range(7)])
    return _robot("seven", xyz, np.tile(np.eye(3), (7, 1, 1)), axes, 2.6, [0, 0, 0.15])


def random_arm(rng: np.random.Generator, n: int = 6, sliding: bool = False) -> Robot:
    """Any serial chain; with `sliding`, some joints are prismatic."""
    axes = rng.normal(size=(n, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    turns = rng.normal(size=(n, 3))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    rotation = axis_angle_to_matrix(turns, rng.uniform(-np.pi, np.pi, n))
    base = Pose(rng.normal(size=3), _unit(rng.normal(size=4)))
    tool = Pose(0.2 * rng.normal(size=3), _unit(rng.normal(size=4)))
    prismatic = rng.uniform(size=n) < 0.4 if sliding else np.zeros(n, dtype=bool)
    return _robot("random", 0.3 * rng.normal(size=(n, 3)), rotation, axes, 2.0, tool, prismatic, base)


def beads(robot: Robot, radius: float = 0.05) -> SphereCover:
    """Two spheres a link: at its origin, and half way to what comes next."""
    ahead = [*robot.joint_xyz[1:], robot.tool().T_link_tool.position]
    links = np.repeat(np.arange(1, robot.dof + 1), 2)
    centres = np.array([point for step in ahead for point in (np.zeros(3), 0.5 * step)])
    return SphereCover(links, centres, np.full(len(links), radius))


def box(name: str, centre: tuple[float, ...], half: tuple[float, ...]) -> Piece:
    """An axis-aligned box."""
    return Piece(name, "box", Pose.from_xyz(centre), np.array(half))


def distant_pairs(cover: SphereCover, links: int = 3) -> NDArray[np.int64]:
    """Every two spheres (p, 2) at least that many links apart."""
    one, two = np.triu_indices(len(cover), 1)
    apart = np.abs(cover.link[one] - cover.link[two]) >= links
    return np.stack([one[apart], two[apart]], axis=1)


def gap_of_pairs(problem: IKProblem, q: Array) -> float:
    """The smallest gap (metres) of a problem's pairs of spheres, from the exact kinematics."""
    rotation, position = ExactKinematics(problem.robot).links(q)
    cover, (one, two) = problem.cover, problem.self_collision.T
    centres = (rotation[cover.link] @ cover.centre[..., None])[..., 0] + position[cover.link]
    return (np.linalg.norm(centres[one] - centres[two], axis=1) - cover.radius[one] - cover.radius[two]).min()


def hugged(robot, cover, rng, count=25) -> IKProblem:
    """A problem whose hidden solution has boxes 1 to 40 mm away on many sides: a thin set of solutions."""
    q = robot.random_configuration(rng)
    kinematics = ExactKinematics(robot)
    rotation, position = kinematics.links(q)
    centres = (rotation[cover.link] @ cover.centre[..., None])[..., 0] + position[cover.link]
    pieces: list[Piece] = []
    while len(pieces) < count:
        half, direction = rng.uniform(0.03, 0.12, 3), rng.normal(size=3)
        chosen = rng.integers(len(cover))
        reach = cover.radius[chosen] + rng.uniform(0.03, 0.2)
        piece = box(
            f"box {len(pieces)}", centres[chosen] + reach * direction / np.linalg.norm(direction), tuple(half)
        )
        gap = smallest_clearance(cover, rotation, position, ExactDistances((piece,)))[0]
        if 1e-3 < gap < 0.04:
            pieces.append(piece)
    return IKProblem(robot, robot.fk(q), tuple(pieces), cover)


def _unit(v):
    return v / np.linalg.norm(v)


def _robot(name, xyz, rotation, axes, limit, tool, prismatic=None, base=None) -> Robot:
    n = len(xyz)
    pose = tool if isinstance(tool, Pose) else Pose.from_xyz(tool)
    limits = np.full(n, float(limit))
    return Robot(
        name=name,
        joint_names=tuple(f"j{k + 1}" for k in range(n)),
        link_names=("base", *(f"link{k + 1}" for k in range(n))),
        parents=np.arange(n),
        joint_xyz=xyz,
        joint_rotation=rotation,
        axis=axes,
        prismatic=np.zeros(n, dtype=bool) if prismatic is None else prismatic,
        lower=-limits,
        upper=limits,
        velocity=np.full(n, np.inf),
        acceleration=np.full(n, np.inf),
        effort=np.full(n, np.inf),
        tools={"tool": Tool("tool", n, pose)},
        default_tool="tool",
        T_world_base=Pose.identity() if base is None else base,
    )
