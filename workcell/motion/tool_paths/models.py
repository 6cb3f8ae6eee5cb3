"""Models that local tracking tries, one after the other: from the most careful to the boldest."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from workcell.geometry.types import SphereCover
from workcell.ik.problem import IKProblem
from workcell.ik.shared.packing import pack_world
from workcell.world.model_clearance import ModelClearance

if TYPE_CHECKING:
    from workcell.kernels.structures import World

ROOM, GENEROUS = 1e-3, 6e-3
"""Metres of clearance beyond what is asked for that waypoints keep where they can: what lies between them needs
some."""


def worlds(template: IKProblem, keep: float) -> list[World]:
    """Models to track in, from the most careful to the boldest, for a clearance of `keep` metres.

    An outer cover may forbid what the true shape allows: where the template has a checker of its own, which decides,
    its spheres are tried without their overshoot as well. They no longer contain the robot, so with more clearance
    first.
    """
    outer = pack_world(_with_pairs(template, template.cover))
    made = [outer._replace(required=keep + ROOM)]
    bare = None if template.cover is None else template.cover.without_overshoot()
    if template.checker is not None and bare is not template.cover:
        inner = pack_world(_with_pairs(template, bare))
        made += [inner._replace(required=keep + more) for more in (GENEROUS, ROOM)]
    return [*made, made[-1]._replace(required=keep)]


def _with_pairs(template: IKProblem, cover: SphereCover | None) -> IKProblem:
    """The template with a cover, and with the pairs of its spheres that can hit each other, where the world tells."""
    known, world = replace(template, cover=cover), template.checker
    if template.self_collision is not None or cover is None or not isinstance(world, ModelClearance):
        return known
    return replace(known, self_collision=world.self_pairs(template.robot, cover))
