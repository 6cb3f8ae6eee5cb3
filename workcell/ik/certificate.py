"""`Certificate`: a proof that a problem has no solution, in a form that can be saved and re-checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

from workcell.pose import Array, read_only

Scope = Literal["kinematics", "geometry", "model"]
"""What a proof is about: the kinematics alone (UNREACHABLE), the true geometry (BLOCKED), the conservative model."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """Why no configuration solves a problem.

    Attributes:
        kind: the form of proof, e.g. `farkas` (a ray of the relaxation's dual cone) or `reach` (an elementary bound).
        scope: what it is about.
        statement: the claim in words, with the tolerances it covers.
        margin: by how much the proof holds, in the units of its inequality; positive.
        problem_hash: of the problem it belongs to.
        data: the numbers of the proof.
    """

    kind: str
    scope: Scope
    statement: str
    margin: float
    problem_hash: str
    data: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "data", MappingProxyType({k: read_only(v) for k, v in self.data.items()}))
