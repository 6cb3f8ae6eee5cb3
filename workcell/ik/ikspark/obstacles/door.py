"""What `ikspark` refuses of a free space that it is given: one made for another scene, or for another cover."""

from __future__ import annotations

from workcell.geometry.free_space.admissible import check_table
from workcell.geometry.free_space.valid import check_free
from workcell.identity_cache import ByIdentity
from workcell.ik.problem import IKProblem

_free = ByIdentity()
"""Free space and obstacles that were found to fit."""


def check_free_space(problem: IKProblem) -> None:
    """Refuse a free space whose table is of another cover, or one of whose regions overlaps an obstacle.

    Raises:
        InputError: as said, with the region and the obstacle.
    """
    given = problem.free_space
    if given is None or problem.cover is None:
        return
    check_table(problem.robot, problem.cover, given)
    if problem.grow is not None:
        return  # whoever lets it grow among these obstacles proves it
    _free.get((given, problem.obstacles), lambda: check_free(given, problem.obstacles))
