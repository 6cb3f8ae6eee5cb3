"""Strangers' cells put to workcell: nothing is lost, called impossible, or contradicted by plain MuJoCo."""

import pytest

from workcell.bench.strangers.cells import random_cell
from workcell.bench.strangers.tasks import random_task
from workcell.bench.strangers.trial import try_cell
from workcell.bench.strangers.urdf import random_urdf

CELLS = 34
"""Of each kind and part: 204 in all."""


@pytest.mark.parametrize("part", [0, 1])
@pytest.mark.parametrize("make", [random_cell, random_task, random_urdf])
def test_plain_mujoco_has_nothing_against_the_answers(make, part):
    solved, refused = 0, []
    for seed in range(part * CELLS, (part + 1) * CELLS):
        outcome = try_cell(make(seed), queries=2, paths=1 if seed % 4 == 0 else 0)
        assert not outcome.failures, seed
        solved += outcome.solved
        refused += [outcome.refused] if outcome.refused else []
    assert solved > CELLS
    # the only models that are refused are those whose followers have no value left
    assert all("at no value of that joint's" in words or "collides there" in words for words in refused)
