"""What every run of a task has to show: each configuration of each way is the planner's, within its bounds."""

from __future__ import annotations

from collections.abc import Iterable

from workcell.record.read.review import Review

LINK_ROTATION = 0.28
"""The bound of every task, Frobenius norm."""


def check_planned(seen: Review, planner: str, ways: Iterable[str]) -> None:
    """Every solved query is the planner's, and these ways, beside others, consist of its steps within the bounds."""
    (check,) = (check for check in seen.checks if check.name == "planner")
    assert check.passed, check.finding
    rows = {row.what: row for row in seen.ways}
    for way in ways:
        row = rows[way]
        assert row.steps, way
        assert row.by and all(name.split("+")[0] == planner for name, _ in row.by), row
        assert row.step is not None and row.step.bound and row.step.largest <= row.step.bound
        assert row.link_rotation is not None and row.link_rotation.bound == LINK_ROTATION
        assert row.link_rotation.largest <= LINK_ROTATION
