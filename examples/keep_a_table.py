"""Keep which sphere of an arm can be in which cuboid of the free space: found once, then read from its file.

The convex planners begin with fewer pairs so. `workcell decompose CELL --table FILE.npz` writes the same file.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from workcell import PlanningWorld, Scene, WorkcellError, solve
from workcell.geometry.free_space.admissible import load_table, save_table, with_table

scene = Scene.load("keep_upright")
world = PlanningWorld.of(scene, approached=["cup"])
robot, cover, free_space = world.robot.robot, world.cover, world.free_space

with tempfile.TemporaryDirectory() as folder:
    file = save_table(Path(folder) / "pairs.npz", robot, cover, with_table(robot, cover, free_space))
    print(f"{file.stat().st_size} bytes")
    later = load_table(file, robot, cover, free_space)  # in another process, on another day
    print(
        f"{len(cover)} spheres, {len(later)} cuboids, {np.mean(later.admissible):.0%} of the pairs are possible"
    )
    try:
        load_table(file, robot, cover, replace(free_space, upper=free_space.upper + 0.01))
    except WorkcellError as error:
        print(f"of other cuboids: {error}")

problem = replace(world.problem(scene.goal("grasp").pose), free_space=later)
print(f"asked with the table: {solve(problem, solver='ikspark', seed=0).status.value}")
