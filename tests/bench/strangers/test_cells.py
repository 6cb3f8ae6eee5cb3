"""Strangers' cells: what the generators make is legal, different, and judged by MuJoCo alone."""

import numpy as np
import pytest

from workcell.bench.strangers.cells import random_cell
from workcell.bench.strangers.oracle import Oracle
from workcell.bench.strangers.tasks import random_task
from workcell.bench.strangers.trial import Outcome, _Trial
from workcell.bench.strangers.urdf import random_urdf
from workcell.ik.result import IKResult, Status

MAKERS = (random_cell, random_task, random_urdf)


@pytest.mark.parametrize("make", MAKERS)
def test_every_seed_is_a_file_of_its_own_that_mujoco_compiles(make):
    texts = set()
    for seed in range(15):
        cell = make(seed)
        assert cell.files == make(seed).files
        texts.add(str(cell.files))
        for prefix, arm in cell.arms.items():
            oracle = Oracle(cell, prefix)
            assert len(oracle.own) == arm.bodies
            assert oracle.own <= oracle.bodies
    assert len(texts) == 15


def test_between_them_they_have_what_strangers_files_have():
    features = set().union(*(make(seed).features for make in MAKERS for seed in range(60)))
    assert {
        "nameless body", "nameless geom", "names alike", "several joints in a body", "joint pos", "joint ref",
        "skew axis", "scaled axis", "frame", "mesh scale", "mirrored mesh", "mesh refquat", "contype", "margin",
        "exclude", "pair", "filterparent off", "nativeccd off", "few ccd iterations", "side body", "coupling",
        "obstacle mocap", "obstacle free", "obstacle hinged", "plane", "hfield", "ellipsoid", "cylinder",
        "object fixed to a hand", "arm on arm", "carriage moved", "limits: locked", "limits: only upper", "mimic",
    } <= features  # fmt: skip


def test_followers_stand_where_their_leaders_want_them():
    cell = next(cell for cell in map(random_cell, range(100)) if cell.arms[""].followers)
    oracle, rng = Oracle(cell), np.random.default_rng(0)
    q = oracle.random_configuration(rng)
    assert q is not None
    follower = cell.arms[""].followers[0]
    moved = q[cell.arms[""].driven.index(follower.leader)] - oracle.model.joint(follower.leader).qpos0[0]
    value = oracle.model.joint(follower.name).qpos0[0] + follower.polycoef[1] * moved
    low, high = oracle.model.joint(follower.name).range
    assert low <= value <= high


def oracle_with_two(least, most):
    """The first cell among whose configurations are one that is clear and one that is deep in something."""
    for seed in range(100):
        oracle, rng = Oracle(random_cell(seed)), np.random.default_rng(1)
        drawn = [q for _ in range(100) if (q := oracle.random_configuration(rng)) is not None]
        free = next((q for q in drawn if oracle.nearest(q).distance > most), None)
        deep = next((q for q in drawn if oracle.nearest(q).distance < least), None)
        if free is not None and deep is not None:
            return oracle, free, deep
    raise AssertionError("no such cell")


def test_a_wrong_answer_is_a_failure_whatever_is_wrong_with_it():
    oracle, free, touching = oracle_with_two(-0.002, 0.002)
    trial = _Trial.__new__(_Trial)
    trial.oracle, trial.outcome = oracle, Outcome()
    trial._contradict("answer", free, oracle.tool_pose(free))
    assert not trial.outcome.failures
    trial._contradict("answer", touching)
    trial._contradict("answer", oracle.limits()[1] + 1.0)
    trial._contradict("answer", free, oracle.tool_pose(touching))
    kinds = [kind for kind, _ in trial.outcome.failures]
    assert set(kinds) == {"contradicted"}
    assert len(kinds) >= 3


def test_a_proof_against_a_planted_configuration_is_a_failure(monkeypatch):
    cell = next(c for c in map(random_cell, range(100)) if "nameless body" not in c.features)
    oracle, rng = Oracle(cell), np.random.default_rng(1)
    q = oracle.random_configuration(rng)
    trial = _Trial.__new__(_Trial)
    trial.oracle, trial.outcome, trial.cell, trial.budget = oracle, Outcome(), cell, None
    trial.baseline = False

    class World:
        def problem(self, target):
            return None

    answer = IKResult(Status.UNREACHABLE, "branch")
    monkeypatch.setattr("workcell.bench.strangers.trial.solve", lambda *args, **kwargs: answer)
    trial._ask(World(), q)
    assert [kind for kind, _ in trial.outcome.failures] == ["impossible"]
