"""`Certificate`: a proof that a problem has no solution, in a form that can be saved and re-checked."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, cast, get_args

import numpy as np

from workcell.errors import InputError
from workcell.files import parse_json
from workcell.geometry.types import Piece
from workcell.identity_cache import ByIdentity
from workcell.ik.problem import IKProblem
from workcell.model.robot import Robot
from workcell.pose import Array, Pose, read_only

FORMAT = "workcell-certificate/1"
MOST_DIMENSIONS = 4
LONGEST_SIDE = 1 << 31

Scope = Literal["kinematics", "geometry", "model", "solution"]
"""What a proof is about: the kinematics alone (UNREACHABLE), the true geometry (BLOCKED), the conservative model; or a
configuration that solves the problem (SOLVED)."""

Grounds = Literal["chain", "spheres", "cuboids"]
"""What a proof rests on: the chain and its limits alone, spheres that collide, spheres that no free cuboid has room
for."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """Why no configuration solves a problem, or why one does.

    Attributes:
        kind: the form of proof, e.g. `farkas` (a ray of the relaxation's dual cone) or `reach` (an elementary bound).
        scope: what it is about.
        statement: the claim in words, with the tolerances it covers.
        margin: by how much the proof holds, in the units of its inequality; positive.
        problem_hash: of the problem it belongs to.
        data: the numbers of the proof.
    """

    kind: str
    scope: Scope
    statement: str
    margin: float
    problem_hash: str
    data: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "data", MappingProxyType({k: read_only(v) for k, v in self.data.items()}))

    def to_json(self) -> dict[str, Any]:
        """A JSON document that `from_json` reads back exactly."""
        return {
            "format": FORMAT,
            "kind": self.kind,
            "scope": self.scope,
            "statement": self.statement,
            "margin": self.margin,
            "problem_hash": self.problem_hash,
            "data": {
                name: {"shape": list(a.shape), "values": a.ravel().tolist()} for name, a in self.data.items()
            },
        }

    @staticmethod
    def from_json(document: Any, where: str = "certificate") -> Certificate:
        """Read a document that `to_json` wrote.

        Raises:
            InputError: it is damaged, or not a certificate; `where` and the element begin the message.
        """
        if isinstance(document, str):
            try:
                document = parse_json(document)
            except ValueError as error:
                raise InputError(f"not JSON: {error}", where=where) from None
        if not isinstance(document, dict) or document.get("format") != FORMAT:
            raise InputError("not a certificate", where=where, remedy=f'an object with "format": "{FORMAT}"')
        texts = {name: document.get(name) for name in ("kind", "scope", "statement", "problem_hash")}
        for name, value in texts.items():
            if not isinstance(value, str):
                raise InputError("missing, or not a text", where=f"{where}.{name}")
        if texts["scope"] not in get_args(Scope):
            raise InputError(
                f"unknown scope {ascii(texts['scope'])[:60]}",
                where=f"{where}.scope",
                remedy=", ".join(get_args(Scope)),
            )
        margin, data = _numbers([document.get("margin")]), document.get("data")
        if margin is None:
            raise InputError("missing, or not a finite number", where=f"{where}.margin")
        if not isinstance(data, dict):
            raise InputError("missing, or not an object", where=f"{where}.data")
        return Certificate(
            kind=str(texts["kind"]),
            scope=cast(Scope, texts["scope"]),
            statement=str(texts["statement"]),
            margin=float(margin[0]),
            problem_hash=str(texts["problem_hash"]),
            data={
                name: _array(entry, f"{where}.data.{ascii(name)[1:-1][:60]}") for name, entry in data.items()
            },
        )


def _array(entry: Any, where: str) -> Array:
    """An array from its JSON object: whole numbers as shape, and as many finite numbers."""
    shape, values = (
        (entry.get(name) for name in ("shape", "values")) if isinstance(entry, dict) else (None, None)
    )
    if not isinstance(shape, list) or not isinstance(values, list) or len(shape) > MOST_DIMENSIONS:
        raise InputError('damaged: needs "shape" and as many "values"', where=where)
    if any(type(size) is not int or not 0 <= size <= LONGEST_SIDE for size in shape):
        raise InputError('damaged: "shape" holds what is no size of an array', where=where)
    if math.prod(shape) != len(values):
        raise InputError(f"damaged: {len(values)} values do not fit into {shape}", where=where)
    array = _numbers(values)
    if array is None:
        raise InputError("a value is not finite, or not a number", where=where)
    return array.reshape(shape)


def _numbers(values: list[Any]) -> Array | None:
    """Values as doubles, or None unless all of them are numbers (no truth values, no texts) and finite."""
    if not set(map(type, values)) <= {int, float}:
        return None
    try:
        array = np.array(values, dtype=float)
    except OverflowError:
        return None
    return array if bool(np.all(np.isfinite(array))) else None


_HASHES, _ROBOTS, _COVERS = ByIdentity(), ByIdentity(), ByIdentity()


def problem_hash(problem: IKProblem) -> str:
    """SHA-256 (hex) of everything that a certificate depends on.

    That is chain, limits, target, obstacles, cover, bounds and tolerances. Names and the collision checker
    are left out: no proof uses them.
    """
    if not isinstance(problem.obstacles, tuple):
        return _digest(problem)  # a list may change between two calls
    return _HASHES.get((problem,), lambda: _digest(problem))


def _digest(problem: IKProblem) -> str:
    robot, cover = problem.robot, problem.cover
    digest = hashlib.sha256(_ROBOTS.get((robot,), lambda: as_bytes(_of_robot(robot))))
    digest.update(as_bytes([*_pose(problem.target), "obstacles"]))
    digest.update(as_bytes(item for piece in problem.obstacles for item in _of_piece(piece)))
    if cover is not None:
        parts = ("cover", cover.link, cover.centre, cover.radius)
        digest.update(_COVERS.get((cover,), lambda: as_bytes(parts)))
    digest.update(as_bytes(_of_bounds(problem)))
    return digest.hexdigest()


def as_bytes(items: Iterable[Any]) -> bytes:
    """Texts and arrays, each with its kind and length, so that no two contents look the same."""
    parts = []
    for item in items:
        if isinstance(item, str):
            data = item.encode()
            parts.append(b"text:%d:" % len(data))
        else:
            values = np.asarray(item, dtype=float) + 0.0  # -0.0 and 0.0 are the same number
            data = values.tobytes()
            parts.append(_SHAPES.get(values.shape) or f"{values.shape}:{len(data)}:".encode())
        parts.append(data)
    return b"".join(parts)


_SHAPES = {(n,): f"({n},):{8 * n}:".encode() for n in range(10)}


def _of_robot(robot: Robot) -> Iterator[Any]:
    yield from (robot.parents, robot.joint_xyz, robot.joint_rotation, robot.axis, robot.prismatic)
    yield from (robot.lower, robot.upper, *_pose(robot.T_world_base), robot.tool().link)
    yield from _pose(robot.tool().T_link_tool)
    if robot.coupling is not None:
        yield from ("coupling", robot.coupling.variable, robot.coupling.coefficients, robot.coupling.own)


def _of_piece(piece: Piece) -> tuple[Any, ...]:
    vertices = _NONE if piece.vertices is None else piece.vertices
    return piece.kind, piece.pose.position, piece.pose.quat_wxyz, piece.size, vertices


_NONE = np.zeros(0)


def _of_bounds(problem: IKProblem) -> Iterator[Any]:
    tolerances = problem.tolerances
    if problem.free_space is not None:
        yield from ("free space", problem.free_space.lower, problem.free_space.upper)
        if problem.free_space.admissible is not None:
            yield from ("admissible", problem.free_space.admissible)
    for name in ("q_reference", "max_step", "max_link_rotation"):
        value = getattr(problem, name)
        if value is not None:
            yield from (name, value)
    yield from (tolerances.position, tolerances.rotation, tolerances.safety_margin)
    if problem.goal != "pose":
        yield from ("goal", problem.goal)
    if problem.self_collision is not None:
        yield from ("self collision", problem.self_collision)


def _pose(pose: Pose) -> tuple[Array, Array]:
    return pose.position, pose.quat_wxyz


def proof_scope(problem: IKProblem, grounds: Grounds) -> Scope:
    """What a proof is about, by what it rests on; all who issue one ask here.

    Spheres inside the robot, or given as its shape with no other judge, prove something of the true geometry; spheres
    that cover it from outside only of the model they belong to, and so do cuboids, which hold a part of the free space.
    """
    if grounds == "chain":
        return "kinematics"
    cover = problem.cover
    if grounds == "cuboids" or cover is None:
        return "model"
    true_shape = cover.kind == "inner" or (cover.kind == "given" and problem.checker is None)
    return "geometry" if true_shape else "model"
