"""The search of a robot with nothing to avoid but itself."""

from __future__ import annotations

from contextlib import ExitStack

from workcell.ik.ikspark.instance import Instance
from workcell.ik.ikspark.obstacles.branching import Instances
from workcell.ik.ikspark.obstacles.own import OwnSpheres
from workcell.ik.ikspark.rank import linearise
from workcell.ik.ikspark.search import Reached, Search
from workcell.ik.result import Candidate
from workcell.pose import Array

ROUNDS = 4
"""Ascents that part spheres, after one whose end has two of them in each other."""


class Alone:
    """The relaxation as it is, and with rows where a point has two of the robot's own spheres in each other."""

    exhausted = False

    def __init__(self, search: Search, instance: Instance, own: OwnSpheres, stack: ExitStack) -> None:
        self._search, self._instance, self._own = search, instance, own
        self._instances = Instances(search.problem, stack)

    def climb(self) -> Reached:
        """One restart: an ascent, one that heads for where the spheres that met part, then with ever more rows.

        The first ascent's end is returned where none of them is accepted, for what it may prove.
        """
        search, own = self._search, self._own
        first = reached = search.attempt(self._instance, search.direction(self._instance.lift))
        own.restart()
        for turn in range(ROUNDS):
            if reached.accepted or search.over():
                break
            if not (own.turn() if reached.x is None else own.part(reached)):
                break
            convex = self._instances.with_rows(own.rows) if turn else self._instance
            reached = search.attempt(convex, own.pushed(self._towards(first)), ", its own spheres apart")
        return reached if reached.accepted else first

    def answer(self, q: Array) -> Candidate:
        """The configuration alone."""
        return self._search.answer(q)

    def _towards(self, first: Reached) -> Array:
        """Where an ascent with rows begins: near where the first one ended for steps, else anywhere."""
        if self._search.problem.max_step is None or first.x is None:
            return self._search.rng.standard_normal(self._instance.lift.size)
        return linearise(self._instance.lift, first.x)[1]
