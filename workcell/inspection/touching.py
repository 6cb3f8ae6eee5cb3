"""Pairs of geoms that touch in every configuration, or in most, and what can be done in the file's own format."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from workcell.inspection.findings import Finding, beware, wrong
from workcell.model.collision_model import CollisionModel
from workcell.model.judge.distances import judge_model
from workcell.model.labels import geom_name
from workcell.model.overlap import remedy

if TYPE_CHECKING:
    from workcell.model.scene import Scene
    from workcell.model.scene_parts import SceneRobot

SAMPLES = 200
"""Random configurations that are looked at."""
MOST = 0.5
"""Share of them from which a pair is told."""


def touching_findings(scene: Scene) -> Iterator[Finding]:
    """Pairs of a robot's geoms, with each other or with what stands around, that few configurations part, or none."""
    for robot in scene.robots.values():
        for (a, b), share in touching_shares(scene, robot).items():
            first, second = (geom_name(scene.model, g) for g in (a, b))
            data = {"robot": robot.name, "geoms": [first, second], "share": share}
            if share == 1.0:
                text = f"{first} and {second} touch in every configuration, so that none is accepted"
                yield wrong("touching", f"{text}{remedy(scene, robot, (a, b))}", **data)
            else:
                text = f"{first} and {second} touch in {100 * share:.0f} % of random configurations"
                yield beware("touching", f"{text}{remedy(scene, robot, (a, b))}", **data)


def touching_shares(scene: Scene, robot: SceneRobot) -> dict[tuple[int, int], float]:
    """The share of configurations, the start among them, in which each pair of geoms (ids) overlaps: `MOST` or more."""
    import mujoco

    collision, judge = CollisionModel(scene, robot.name), judge_model(scene.model)
    data = mujoco.MjData(scene.model)
    drawn = robot.robot.random_configuration(np.random.default_rng(0), SAMPLES)
    parted = {(int(a), int(b)): 0 for a, b in collision.pair_geoms}
    for q in (robot.start, *drawn):
        data.qpos[:] = collision.full_qpos(q)
        mujoco.mj_kinematics(scene.model, data)
        for pair in parted:
            parted[pair] += not judge.distance(data, *pair, 0.0) < 0.0
        # a pair that has come apart too often needs no more looks
        parted = {pair: count for pair, count in parted.items() if count <= (1 - MOST) * (SAMPLES + 1)}
    return {pair: 1.0 - count / (SAMPLES + 1) for pair, count in parted.items()}
