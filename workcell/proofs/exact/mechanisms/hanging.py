"""How nodes are known by what they hang by (12.5)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from workcell.proofs.exact.certificates import index
from workcell.proofs.exact.mechanisms.derived import HALF, ROOT_OF_8, TWISTED, Derived
from workcell.proofs.exact.mechanisms.question import Question
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.spans import UNIT, ZERO, Span, cos_sin, length, smaller, span
from workcell.proofs.exact.vectors import IDENTITY, Matrix, Vector, add, multiply, subtract, transpose, turn

WORLD = -1
_FOUR = span(4)


@dataclass(frozen=True, slots=True)
class Known:
    """`R_node = R_root Rot(axis, sigma psi) D` up to delta; `turned` is the hinge that psi is the value of, or -1."""

    root: int
    rotation: Matrix
    D: Matrix
    axis: Vector | None = None
    turned: int = -1
    sigma: Span = UNIT
    delta: Span = ZERO


class Hanging:
    """Follows the array `hangs`."""

    def __init__(
        self, question: Question, derived: Derived, hangs: tuple[float, ...], twist: Span, *, reached: bool
    ) -> None:
        self.question, self.derived, self.hangs = question, derived, hangs
        self.twist, self.reached = twist, reached
        self._found: dict[int, Known | None] = {0: Known(WORLD, IDENTITY, IDENTITY)}
        self._open: set[int] = set()

    def of(self, node: int) -> Known | None:
        """How a node is known; None where it hangs by nothing.

        Raises:
            RefusedError: by rule 12.5.
        """
        if node not in self._found:
            if node in self._open:
                raise RefusedError(f"link {node} hangs on itself")
            self._open.add(node)
            self._found[node] = self._follow(node)
        return self._found[node]

    def rigid(self, link: int) -> tuple[Known, Matrix] | None:
        """How a link's node is known without an axis, and the link's rotation; None where it is not."""
        known = self.of(self.derived.node[link])
        if known is None or known.axis is not None:
            return None
        return known, multiply(known.rotation, known.D, self.derived.inner[link])

    def _follow(self, node: int) -> Known | None:
        n, c, g = len(self.question.joints), len(self.question.ties), len(self.question.goals)
        if self.hangs[node] == -1:
            return None
        by = index(self.hangs[node], 2 * n + c + g, "what a node hangs by")
        if by < n:
            return self._by_joint(node, by, held=False)
        if by < n + c:
            return self._by_weld(node, by - n)
        if by < n + c + g:
            return self._by_goal(node, by - n - c)
        return self._by_joint(node, by - n - c - g, held=True)

    def _other(self, node: int, other: int) -> Known:
        known = None if node == other else self.of(other)
        if known is None:
            raise RefusedError(f"link {node} hangs on link {other}, which is not known")
        return known

    def _by_joint(self, node: int, k: int, *, held: bool) -> Known:
        joint, d = self.question.joints[k], self.derived
        above = d.node[joint.parent]
        if joint.kind not in (("hinge", "ball") if held else ("hinge",)) or node not in (above, k + 1):
            raise RefusedError(f"link {node} does not hang by joint {k}")
        down = node == k + 1
        known = self._other(node, above if down else k + 1)
        X = d.inner[joint.parent]
        middle = d.rest[k] if held else joint.rotation
        D = multiply(known.D, X, middle) if down else multiply(known.D, transpose(middle), transpose(X))
        if held:
            stray = ROOT_OF_8 * abs(cos_sin(d.half[k] * HALF)[1])
            return replace(known, D=D, turned=-1, delta=known.delta + stray)
        axis = turn(D if down else known.D, joint.axis)
        if known.axis is None:
            return replace(known, D=D, axis=axis, turned=k, sigma=UNIT if down else -UNIT)
        apart = smaller(length(subtract(axis, known.axis)), length(add(axis, known.axis)))
        return replace(known, D=D, turned=-1, delta=known.delta + _FOUR * apart)

    def _by_weld(self, node: int, c: int) -> Known:
        one, two = self.question.ties[c].ends
        if self.derived.node[one.link] != node:
            one, two = two, one
        if not self.question.ties[c].is_weld or self.derived.node[one.link] != node:
            raise RefusedError(f"link {node} does not hang by closure {c}")
        known, X = self._other(node, self.derived.node[two.link]), self.derived.inner
        D = multiply(known.D, X[two.link], two.rotation, transpose(one.rotation), transpose(X[one.link]))
        return replace(known, D=D, turned=-1, delta=known.delta + TWISTED * self.twist)

    def _by_goal(self, node: int, g: int) -> Known:
        goal = self.question.goals[g]
        link = goal.frame.link
        if not self.reached or goal.rotation is None or self.derived.node[link] != node:
            raise RefusedError(f"link {node} does not hang by goal {g}")
        turned = multiply(self.derived.inner[link], goal.frame.rotation)
        return Known(g, multiply(goal.rotation, transpose(turned)), IDENTITY)
