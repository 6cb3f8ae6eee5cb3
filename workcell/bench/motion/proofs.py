"""Bench of continuous proofs: random paths and smooth motions among boxes, checked densely, and planted grazes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from workcell.bench.reference.robots import bench_robot
from workcell.bench.rows import Bench, Row
from workcell.geometry.types import Piece, SphereCover
from workcell.motion.polynomials import PolynomialMotion
from workcell.motion.proofs.on_model import Proof
from workcell.motion.proofs.on_spheres import CoverProver
from workcell.pose import Array, Pose
from workcell.sets.reports import cpu_figures

_DENSE = 1e-4
"""Radians between the configurations that a proof is checked against."""

Way = Array | PolynomialMotion
"""Corners (k, n) of a path of straight lines, or a motion."""


def proof_rows(n: int, seed: int, sets: Path | None) -> list[Row]:
    """Proofs of random joint paths of the Sawyer among 30 boxes, and of smooth motions through the same corners."""
    return [_row(what, n, seed) for what in ("paths", "motions")]


def _row(what: str, n: int, seed: int) -> Row:
    robot, cover = bench_robot("sawyer")
    rng = np.random.default_rng(seed)
    proved, wrong, missed, cpu, looks = 0, 0, 0, [], []
    found, planted = 0, 0
    for k in range(n):
        if k % 20 == 0:
            boxes = _boxes(rng, 30)
            prover = CoverProver(robot, cover, boxes)
            _prove(prover, np.zeros((2, robot.dof)))
            _prove(prover, through(np.zeros((2, robot.dof))))
        points = _random_path(rng, robot.joint_limits)
        way: Way = points if what == "paths" else through(points)
        began = time.process_time()
        proof = _prove(prover, way)
        cpu.append(time.process_time() - began)
        looks.append(float(proof.evaluations))
        limit = max(proof.margin, 0.0) + 1e-3
        dense = min(float(prover.clearance.many(q, limit).min()) for q in _densely(way))
        proved += proof.proved
        wrong += proof.proved and dense < max(proof.margin, 0.0) - 1e-9
        missed += not proof.proved and dense > 1e-5
        if proof.proved:
            planted += 1
            graze = _graze(prover, cover, way, rng)
            found += not _prove(CoverProver(robot, cover, (*boxes, graze)), way).proved
    mean, median, p95 = cpu_figures(cpu)
    return {
        "row": f"sawyer/random-{what}/proof",
        "n": n,
        "proved": proved,
        "wrong": wrong,
        "refused_though_clear": missed,
        "grazes_planted": planted,
        "grazes_found": found,
        "cpu_ms_mean": mean,
        "cpu_ms_median": median,
        "cpu_ms_p95": p95,
        "cpu_ms_max": 1e3 * max(cpu),
        "looks_median": float(np.median(looks)),
        "spheres": len(cover),
    }


def _prove(prover: CoverProver, way: Way) -> Proof:
    return prover.motion(way) if isinstance(way, PolynomialMotion) else prover.path(way)


def through(points: Array) -> PolynomialMotion:
    """A smooth motion through corners (k, n), a second from each to the next, at rest at both ends: cubics."""
    rates = np.zeros_like(points)
    rates[1:-1] = 0.5 * (points[2:] - points[:-2])
    step, begin, end = np.diff(points, axis=0), rates[:-1], rates[1:]
    cubics = [points[:-1], begin, 3.0 * step - 2.0 * begin - end, begin + end - 2.0 * step]
    return PolynomialMotion(np.stack(cubics, axis=2), np.ones(len(step)))


def _boxes(rng: np.random.Generator, count: int) -> tuple[Piece, ...]:
    """Boxes around the robot, none within 0.25 m of its base's axis."""
    pieces: list[Piece] = []
    while len(pieces) < count:
        centre, half = rng.uniform([-1, -1, -0.3], [1, 1, 1.2]), rng.uniform(0.02, 0.1, 3)
        if np.hypot(*centre[:2]) > 0.25 + np.hypot(*half[:2]):
            pieces.append(Piece(f"box {len(pieces)}", "box", Pose.from_xyz(centre), half))
    return tuple(pieces)


def _random_path(rng: np.random.Generator, limits: Array) -> Array:
    """Two to four corners, 0.05 to 1 rad apart."""
    points = [rng.uniform(limits[:, 0], limits[:, 1])]
    for _ in range(int(rng.integers(1, 4))):
        step = rng.normal(size=len(limits))
        moved = points[-1] + step / np.linalg.norm(step) * rng.uniform(0.05, 1.0)
        points.append(np.clip(moved, limits[:, 0], limits[:, 1]))
    return np.array(points)


def _densely(way: Way) -> Iterator[Array]:
    """Configurations (k, n) of each line or piece, at most `_DENSE` radians apart."""
    if isinstance(way, PolynomialMotion):
        begins = np.concatenate([[0.0], np.cumsum(way.durations)])
        fastest = way.largest(1).max(axis=1) * way.durations
        for begin, end, turn in zip(begins[:-1], begins[1:], fastest, strict=True):
            yield way.at(np.linspace(begin, end, max(2, int(turn / _DENSE) + 2)))
    else:
        for a, b in pairwise(way):
            count = max(2, int(np.abs(b - a).max() / _DENSE) + 1)
            yield a + np.linspace(0, 1, count)[:, None] * (b - a)


def _graze(prover: CoverProver, cover: SphereCover, way: Way, rng: np.random.Generator) -> Piece:
    """A ball of 1 cm that some moving sphere enters by 1 mm at a random place of the first line or piece."""
    share = rng.uniform(0.2, 0.8)
    if isinstance(way, PolynomialMotion):
        q = way.at(np.array([share * way.durations[0]]))[0]
    else:
        q = way[0] + share * (way[1] - way[0])
    centres = cover.centres_world(prover.robot.link_transforms(q))
    sphere = int(rng.choice(np.flatnonzero(cover.link >= 3)))
    away = rng.normal(size=3)
    away /= np.linalg.norm(away)
    place = centres[sphere] + (cover.radius[sphere] + 0.01 - 1e-3) * away
    return Piece("graze", "sphere", Pose.from_xyz(place), np.array([0.01]))


BENCHES = (
    Bench(
        "plan-proof",
        1000,
        "continuous proofs of random paths and motions, checked every 1e-4 rad, and planted grazes",
        proof_rows,
    ),
)
