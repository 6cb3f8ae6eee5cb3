"""An arm in whole numbers, and its links as they are seen from the base and from the target (rule 6.6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workcell.proofs.exact.convex.joints import perpendicular
from workcell.proofs.exact.problems import Problem
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import ONE as SPAN_ONE
from workcell.proofs.exact.spans import ZERO, Span, length, span, square, total
from workcell.proofs.exact.tree.fixed import ONE, Flags, Ints, cos_sin, down, nearest
from workcell.proofs.exact.vectors import (
    IDENTITY,
    Matrix,
    Vector,
    add,
    cross,
    cross_matrix,
    dot,
    multiply,
    outer,
    scale,
    subtract,
    transpose,
    turn,
)


@dataclass(frozen=True, slots=True)
class FixedArm:
    """What the boxes of one certificate are looked at with; lengths in units of `2 ** units` metres.

    Attributes:
        turning: (n, 3, 3, 3) M, C, S of each joint: J_k Rot(a_k, q) = M + cos q C + sin q S.
        offset: (n, 3) x_k.
        first, last: rotation (3, 3) and origin (3,) of the base, and of link n at the target.
        near, far: (n + 2, 3) a point of every line 0 ... n + 1 in its link's frame, near the line before or after it.
        along: (n + 2, 3) the lines' directions in their link's frames. Line 0 is fixed to link 0, line n + 1 to
        link n. pole: (3,) p_g, about which the ball turns. error: what every rotation's Frobenius norm and every
        place's distance is off by at most. beside: (n + 2,) metres of the far point of line k + 1 from line k: a
        length of the link between, and
            beside_angle: (n + 2,) the sine of the angle between the two; both rounded up. Of line n + 1, unused.
    """

    units: int
    turning: Ints
    offset: Ints
    first: tuple[Ints, Ints]
    last: tuple[Ints, Ints]
    near: Ints
    far: Ints
    along: Ints
    pole: Ints
    error: int
    beside: Ints
    beside_angle: Ints

    @property
    def joints(self) -> int:
        """How many joints turn."""
        return len(self.offset)


def fixed_arm(problem: Problem, places: list[Vector]) -> FixedArm:
    """An arm in whole numbers.

    Args:
        problem: whose arm and target it is.
        places: of obstacles that are looked at as well; the unit of length takes them in.

    Raises:
        RefusedError: it is so large that nothing can be told.
    """
    arm = problem.arm
    joints = arm.joints
    near, far = _feet(problem)
    stretched = total(length(v) for v in (*(joint.offset for joint in joints), arm.tool, problem.target))
    points = [*near, *far, *places, *(sphere.centre for sphere in arm.spheres)]
    size = stretched.high + max(length(point).high for point in points)
    units = max((size - 1).bit_length() - SPAN_ONE.bit_length() + 1, -20)
    if units > 12:
        raise RefusedError("the arm, its target or an obstacle is farther away than some kilometres")
    turning = []
    for joint in joints:
        kept = outer(joint.axis, joint.axis)
        rest: Matrix = tuple(  # type: ignore[assignment]
            subtract(row, other) for row, other in zip(IDENTITY, kept, strict=True)
        )
        parts = (kept, rest, cross_matrix(joint.axis))
        turning.append([_matrix(multiply(joint.rotation, part)) for part in parts])
    rotation = multiply(problem.target_rotation, transpose(arm.tool_rotation))
    origin = subtract(problem.target, turn(rotation, arm.tool))
    along = _directions(problem)
    error = 40 * (len(joints) + 2)
    beside, angle = _between(problem, far, along, units)
    return FixedArm(
        units,
        np.array(turning, dtype=np.int64),
        np.array([_place(joint.offset, units) for joint in joints], dtype=np.int64),
        (np.array(_matrix(IDENTITY), dtype=np.int64), np.zeros(3, dtype=np.int64)),
        (np.array(_matrix(rotation), dtype=np.int64), np.array(_place(origin, units), dtype=np.int64)),
        np.array([_place(point, units) for point in near], dtype=np.int64),
        np.array([_place(point, units) for point in far], dtype=np.int64),
        np.array([_place(direction, 0) for direction in along], dtype=np.int64),
        np.array(_place(problem.target, units), dtype=np.int64),
        error,
        np.array(beside, dtype=np.int64),
        np.array(angle, dtype=np.int64),
    )


def _matrix(m: Matrix) -> list[list[int]]:
    return [[nearest(entry) for entry in row] for row in m]


def _place(v: Vector, units: int) -> list[int]:
    return [nearest(entry, units) for entry in v]


def _directions(problem: Problem) -> list[Vector]:
    """Each line's direction in its link; the two auxiliary lines are normal to the axes beside them."""
    joints = problem.arm.joints
    first = turn(joints[0].rotation, perpendicular(joints[0].axis, joints[0].raw_axis))
    return [first, *(joint.axis for joint in joints), perpendicular(joints[-1].axis, joints[-1].raw_axis)]


def _feet(problem: Problem) -> tuple[list[Vector], list[Vector]]:
    """A point of every line in its link's frame: the foot towards the line before it, and towards the one after it.

    Any point of the line is right; at the feet neighbouring joints move it least.
    """
    joints = problem.arm.joints
    zero = (ZERO, ZERO, ZERO)
    near, far = [joints[0].offset], [joints[0].offset]
    for k, joint in enumerate(joints):
        before = after = ZERO
        if k > 0:  # in link k - 1 the line before is at the origin, along its axis
            turned = turn(joint.rotation, joint.axis)
            before = _foot(joint.offset, turned, zero, joints[k - 1].axis)
        if k + 1 < len(joints):
            following = joints[k + 1]
            turned = turn(following.rotation, following.axis)
            after = _foot(zero, joint.axis, following.offset, turned)
        near.append(scale(before, joint.axis))
        far.append(scale(after, joint.axis))
    return [*near, problem.arm.tool], [*far, problem.arm.tool]


def _foot(point: Vector, direction: Vector, other: Vector, along: Vector) -> Span:
    """How far from a point of a line, along it, the other line is nearest; 0 where they are nearly parallel."""
    cosine = dot(direction, along)
    sine = span(1) - square(cosine)
    if sine.low < SPAN_ONE >> 10:
        return ZERO
    apart = subtract(other, point)
    slide = (dot(apart, direction) - cosine * dot(apart, along)) / sine
    middle = (slide.low + slide.high) // 2
    return Span(middle, middle)


def _between(
    problem: Problem, far: list[Vector], along: list[Vector], units: int
) -> tuple[list[int], list[int]]:
    """How far the far point of line k + 1 is from line k, and the sine of their angle, in link k."""
    arm = problem.arm
    beside, angle = [], []
    for k in range(len(arm.joints) + 1):
        point, direction = far[k + 1], along[k + 1]
        own = far[k] if k == 0 else (ZERO, ZERO, ZERO)
        if k < len(arm.joints):
            joint = arm.joints[k]
            turned = turn(joint.rotation, joint.axis)
            point = add(
                joint.offset, turn(joint.rotation, point)
            )  # a point of the axis: the turn leaves it alone
            direction = turned
        beside.append(nearest(length(cross(subtract(point, own), along[k])), units) + 2)
        angle.append(min(nearest(length(cross(direction, along[k]))) + 2, ONE))
    return [*beside, 0], [*angle, 0]


@dataclass(frozen=True, slots=True)
class View:
    """All links as one side sees them, at the middles of N boxes.

    Attributes:
        rotation: (n + 1, 3, 3, N) and
        origin: (n + 1, 3, N) of the links 0 ... n.
        near, far, along: (3, n + 2, N) points and directions of the lines.
    """

    rotation: Ints
    origin: Ints
    near: Ints
    far: Ints
    along: Ints

    def only(self, which: Ints | Flags) -> View:
        """Of some of the boxes."""
        parts = (self.rotation, self.origin, self.near, self.far, self.along)
        return View(*(part[..., which] for part in parts))


def views(arm: FixedArm, middles: Ints) -> tuple[View, View]:
    """The arm from the base and from the target.

    Errors: a joint's matrix is off by 8 an entry (its parts by 1, cosine and sine by 4, the sum's rounding by 1),
    24 in Frobenius norm, a product of two rounds by 3 more, a place by the link's length (1 at most) times that and
    4 more: 40 for every joint.
    """
    cosine, sine = cos_sin(middles)
    parts = arm.turning[..., None]
    local = parts[:, 0] + down(parts[:, 1] * cosine[:, None, None] + parts[:, 2] * sine[:, None, None])
    n, count = middles.shape
    offset = arm.offset[..., None]
    seen = []
    for forwards in (True, False):
        rotation = np.empty((n + 1, 3, 3, count), dtype=np.int64)
        origin = np.empty((n + 1, 3, count), dtype=np.int64)
        start, place = arm.first if forwards else arm.last
        end = 0 if forwards else n
        rotation[end], origin[end] = start[..., None], place[:, None]
        for k in range(n) if forwards else range(n - 1, -1, -1):
            if forwards:
                rotation[k + 1] = down((rotation[k][:, :, None] * local[k][None]).sum(axis=1))
                origin[k + 1] = origin[k] + down((rotation[k] * offset[k][None]).sum(axis=1))
            else:
                rotation[k] = down((rotation[k + 1][:, None] * local[k][None]).sum(axis=2))
                origin[k] = origin[k + 1] - down((rotation[k] * offset[k][None]).sum(axis=1))
        seen.append(_with_lines(arm, rotation, origin))
    return seen[0], seen[1]


def _with_lines(arm: FixedArm, rotation: Ints, origin: Ints) -> View:
    n = arm.joints
    links = [0, *range(1, n + 1), n]
    turned, placed = rotation[links], origin[links]

    def in_world(vectors: Ints) -> Ints:
        return down((turned * vectors[:, None, :, None]).sum(axis=2))

    points = [np.ascontiguousarray((placed + in_world(p)).swapaxes(0, 1)) for p in (arm.near, arm.far)]
    along = np.ascontiguousarray(in_world(arm.along).swapaxes(0, 1))
    return View(rotation, origin, points[0], points[1], along)
