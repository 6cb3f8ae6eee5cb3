"""CIDGIK beyond its paper: thousands of spheres, binding ones among them, and chains of up to 50 joints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from workcell.bench.ik.cidgik import solver_row
from workcell.bench.reference.cidgik_problems import (
    POINT_RADIUS,
    bench_arm,
    link_points,
    spheres,
    standard_dh,
)
from workcell.bench.rows import Bench, Row
from workcell.geometry.types import SphereCover
from workcell.ik.problem import IKProblem
from workcell.model.robot import Robot
from workcell.pose import Array

SPHERES = (0, 10, 100, 1000, 10_000)
JOINTS = (6, 9, 12, 20, 30, 50)
HUGGING = 400
"""Spheres that stand close to the hidden configuration, where there are that many."""
NEAR = (0.001, 0.01)
"""Metres between those and the arm."""


def _spheres(n: int, seed: int, sets: Path | None) -> list[Row]:
    arm = bench_arm("kuka")
    rows = []
    for count in SPHERES:
        problems = crowded_problems(arm, link_points(arm), count, n, seed)
        rows += [solver_row(f"kuka/{count}-spheres/{s}", problems, s, seed) for s in ("cidgik", "multistart")]
    return rows


def crowded_problems(robot: Robot, cover: SphereCover, count: int, n: int, seed: int) -> list[IKProblem]:
    """Tool poses of random configurations among `count` spheres of 5 cm, up to `HUGGING` of them around the arm.

    The others are anywhere within reach, clear of the configuration by a centimetre or more.
    """
    rng = np.random.default_rng(seed)
    problems = []
    for _ in range(n):
        q = robot.random_configuration(rng)
        links = robot.link_transforms(q)
        # the joints' origins too: those that the base fixes have no sphere of their own
        points = np.vstack([cover.centres_world(links), links[:, :3, 3]])
        centres = _around(points, min(HUGGING, count // 2), rng)
        centres = np.vstack([centres, _anywhere(points, count - len(centres), 1.2 * robot.reach(), rng)])
        pieces = spheres(centres, 0.05)
        problems.append(IKProblem(robot, robot.fk(q), pieces, cover if count else None))
    return problems


def _around(points: Array, count: int, rng: np.random.Generator) -> Array:
    """Centres (count, 3) of 5 cm spheres a little off one point and no nearer to any other."""
    found: list[Array] = []
    while len(found) < count:
        direction = rng.standard_normal(3)
        gap = rng.uniform(*NEAR)
        centre = points[rng.integers(len(points))] + (0.05 + gap) * direction / np.linalg.norm(direction)
        if np.linalg.norm(points - centre, axis=1).min() > 0.05 + NEAR[0]:
            found.append(centre)
    return np.array(found).reshape(-1, 3)


def _anywhere(points: Array, count: int, reach: float, rng: np.random.Generator) -> Array:
    centres = rng.uniform(-reach, reach, (2 * count + 200, 3))
    apart = np.linalg.norm(centres[:, None] - points, axis=-1).min(axis=1)
    clear: Array = centres[apart > 0.05 + NEAR[1] + POINT_RADIUS][:count]
    return clear


def _joints(n: int, seed: int, sets: Path | None) -> list[Row]:
    rows = []
    for joints in JOINTS:
        for label, limit in (("free", np.pi), ("limits", 2.0)):
            arm = long_arm(joints, limit)
            rng = np.random.default_rng(seed)
            problems = [IKProblem(arm, arm.fk(arm.random_configuration(rng))) for _ in range(n)]
            rows += [
                solver_row(f"{joints}-joints/{label}/{s}", problems, s, seed)
                for s in ("cidgik", "multistart")
            ]
    return rows


def long_arm(joints: int, limit: float) -> Robot:
    """Roll and pitch joints in turn, 0.3 m from one pitch joint to the next, each from -limit to limit."""
    rows = [(0.0, 0.3 if k % 2 == 0 and k > 0 else 0.0, -1 if k % 2 == 0 else 1) for k in range(joints)]
    arm = standard_dh(f"chain{joints}", rows)
    return replace(arm, lower=np.full(joints, -limit), upper=np.full(joints, limit))


def _both(n: int, seed: int, sets: Path | None) -> list[Row]:
    return _spheres(n, seed, sets) + _joints(n, seed, sets)


BENCHES = (Bench("cidgik-scaling", 20, "CIDGIK with 0 to 10,000 spheres, and with 6 to 50 joints", _both),)
