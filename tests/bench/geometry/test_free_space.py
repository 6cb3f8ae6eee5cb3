"""When a decomposition counts as built."""

from __future__ import annotations

import numpy as np

from workcell.bench.geometry.free_space import SPHERES, is_built, random_cells
from workcell.geometry.free_space.fill import workspace_box
from workcell.geometry.free_space.polytopes import inflate_polytope
from workcell.geometry.types import FreeSpace

NOWHERE = np.zeros((0, 3))


def test_a_cell_is_built_when_every_sphere_has_a_region_it_may_be_in() -> None:
    (problem,) = random_cells(1, 0, None)
    assert problem.cover is not None and len(problem.cover) == SPHERES
    box = workspace_box(problem.robot)
    assert is_built(problem, FreeSpace(box[:1], box[1:]))
    everything = inflate_polytope(problem.target.position, (), box)
    assert everything is not None
    assert is_built(problem, FreeSpace(NOWHERE, NOWHERE, polytopes=(everything,)))
    corner = FreeSpace(box[:1], box[:1] + 0.3)
    assert not is_built(problem, corner)
    assert not is_built(problem, FreeSpace(NOWHERE, NOWHERE))
