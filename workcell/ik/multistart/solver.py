"""Plain multi-start: Levenberg-Marquardt on the pose with a hinge on penetration, from random starts.

The honest baseline. Many starts (lanes) advance together as numpy batches; a lane that stops improving is
given a new start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workcell import clock
from workcell.geometry.engine import ClearanceEngine, Contacts
from workcell.ik.judge.verify import Verifier, sphere_name
from workcell.ik.multistart.pose_errors import pose_errors
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.result import NEAR_MISSES, Candidate
from workcell.ik.shared.limits import Interval
from workcell.kernels.constants import ROTATION_WEIGHT
from workcell.pose import Array

LANES = 16
"""Starts that advance together."""
STARTS_A_SECOND = 1000
"""Starts that one quiet core makes in a second, about."""
_WEIGHTS = np.array([1.0, 1.0, 1.0, ROTATION_WEIGHT, ROTATION_WEIGHT, ROTATION_WEIGHT])
HINGE_MARGIN = 2e-4
"""Metres beyond the wanted clearance at which the hinge begins, so that a solution is not left on the edge."""
HINGE_WEIGHT = 0.15
"""Weight of a metre of penetration beside a metre of pose error: a soft hinge lets a lane reach the pose first and then
slide clear of the obstacles, a stiff one leaves it in front of them."""
PATIENCE = 5
"""Iterations within which a lane must halve its cost."""
LONGEST_STEP = 0.7
"""Radians (metres) that a joint may move in one iteration."""
FINISH = 0.01
"""Share of the pose tolerances at which a lane that still improves is stopped and judged."""


def solve_multistart(problem: IKProblem, budget: Budget, seed: int = 0) -> Candidate:
    """Look for a configuration by local search from random starts until the budget is spent.

    The first start is `problem.q_reference` where there is one; `max_step` narrows the joint limits. The same seed
    visits the same configurations in the same order.
    """
    search = _Search(problem, seed)
    q = None
    if budget.cpu_s > 0:
        q = search.run(clock.cpu_seconds() + budget.cpu_s, budget.iterations or budget.work(STARTS_A_SECOND))
    stats = {"iterations": float(search.iterations), "starts": float(search.starts)}
    return Candidate(q=q, stats=stats, rejected=search.near_misses())


@dataclass(slots=True)
class _Lanes:
    """A batch of b configurations, evaluated.

    Attributes:
        q: (b, n).
        cost: (b,) sum of squared residuals.
        gradient, hessian: (b, n) and (b, n, n) of half the cost (Gauss-Newton).
        away, turned: (b,) pose errors in metres and radians.
        gap: (b,) worst clearance less the wanted one; inf where nothing is near.
        culprit: (b, 3) of the worst gap the sphere, and the obstacle or the other sphere; -1 for what is not there.
    """

    q: Array
    cost: Array
    gradient: Array
    hessian: Array
    away: Array
    turned: Array
    gap: Array
    culprit: NDArray[np.int64]

    def replace(self, rows: NDArray[np.bool_], other: _Lanes) -> None:
        """Take `rows` from another batch."""
        for name in self.__slots__:
            getattr(self, name)[rows] = getattr(other, name)[rows]


class _Search:
    def __init__(self, problem: IKProblem, seed: int) -> None:
        self.problem = problem
        self.starts = self.iterations = 0
        self._rng = np.random.default_rng(seed)
        self._judge = Verifier(problem)
        interval = Interval.of(problem).closed
        self._lower, self._upper = interval.lower, interval.upper
        self._engine = None
        pairs = problem.self_collision
        if problem.cover is not None and len(problem.cover) > 0 and (problem.obstacles or pairs is not None):
            self._engine = ClearanceEngine(problem.robot, problem.cover, problem.obstacles, pairs)
            self._forgiven = self._forgiveness()
        self._misses: dict[str, float] = {}

    def _forgiveness(self) -> Array:
        """(lanes, spheres) metres by which spheres are shrunk.

        Where another judge knows the true shape, one lane in four takes an outer cover without its overshoot,
        and one sees no obstacle at all and leaves them to the judge.
        """
        cover = self.problem.cover
        assert cover is not None and cover.overshoot is not None
        forgiven = np.zeros((LANES, len(cover)))
        if self.problem.checker is not None:
            forgiven[1::4] = cover.overshoot
            forgiven[3::4] = np.inf
        return forgiven

    def near_misses(self) -> tuple[str, ...]:
        """Why the best lanes that gave up are no solutions, nearest first."""
        return tuple(sorted(self._misses, key=self._misses.__getitem__)[:NEAR_MISSES])

    def run(self, deadline: float, most: float = np.inf) -> Array | None:
        """The first configuration that the judge accepts; None at the deadline, or when `most` starts led nowhere."""
        lanes: _Lanes = self._evaluate(self._fresh(LANES, first=True))
        damping = np.full(LANES, 1e-2)
        age, milestone = np.zeros(LANES, dtype=int), lanes.cost.copy()
        while True:
            found = self._judged(lanes, self._arrived(lanes, FINISH))
            if found is not None:
                return found
            stuck = (age >= PATIENCE) & (lanes.cost > 0.5 * milestone)
            if np.any(stuck):
                found = self._judged(lanes, stuck & self._arrived(lanes, 1.0))
                if found is not None:
                    return found
                self._note_misses(lanes, stuck)
            if clock.cpu_seconds() > deadline or self.starts - LANES >= most:
                return None
            passed = (age >= PATIENCE) & ~stuck
            milestone[passed], age[passed] = lanes.cost[passed], 0
            trial_q = self._step(lanes, damping)
            trial_q[stuck] = self._fresh(int(stuck.sum()))
            trial = self._evaluate(trial_q)
            self.iterations += 1
            better = trial.cost < lanes.cost
            damping = np.clip(np.where(better, damping * 0.2, damping * 5.0), 1e-7, 1e3)
            lanes.replace(better | stuck, trial)
            damping[stuck], age[stuck], milestone[stuck] = 1e-2, -1, lanes.cost[stuck]
            age += 1

    def _fresh(self, count: int, first: bool = False) -> Array:
        self.starts += count
        q = self._rng.uniform(self._lower, self._upper, size=(count, len(self._lower)))
        if first and self.problem.q_reference is not None:
            q[0] = np.clip(self.problem.q_reference, self._lower, self._upper)
        return q

    def _arrived(self, lanes: _Lanes, share: float) -> NDArray[np.bool_]:
        tolerances = self.problem.tolerances
        arrived: NDArray[np.bool_] = (
            (lanes.away <= share * tolerances.position)
            & (lanes.turned <= share * tolerances.rotation)
            & (lanes.gap >= 0)
        )
        return arrived

    def _judged(self, lanes: _Lanes, rows: NDArray[np.bool_]) -> Array | None:
        """The first of these lanes that the judge accepts; refused ones leave their reason."""
        for row in np.flatnonzero(rows):
            verdict = self._judge(lanes.q[row])
            if verdict.accepted:
                return np.array(lanes.q[row])
            self._misses.setdefault("; ".join(verdict.reasons), 0.0)
        return None

    def _note_misses(self, lanes: _Lanes, rows: NDArray[np.bool_]) -> None:
        for row in np.flatnonzero(rows & (lanes.cost < 1e-2)):
            score = float(lanes.cost[row])
            if len(self._misses) >= NEAR_MISSES and score >= sorted(self._misses.values())[NEAR_MISSES - 1]:
                continue
            reason = self._reason(lanes, int(row))
            self._misses[reason] = min(score, self._misses.get(reason, np.inf))

    def _reason(self, lanes: _Lanes, row: int) -> str:
        away = f"{1e3 * lanes.away[row]:.2g} mm and {lanes.turned[row]:.2g} rad from the target"
        if not lanes.gap[row] < 0:
            return f"a local minimum stays {away}"
        sphere, piece, other = map(int, lanes.culprit[row])
        near = sphere_name(self.problem, other) if piece < 0 else self.problem.obstacles[piece].name
        inside = f"{sphere_name(self.problem, sphere)} is {-1e3 * lanes.gap[row]:.2g} mm too near {near}"
        return f"{inside}, {away}"

    def _evaluate(self, q: Array) -> _Lanes:
        error, J = pose_errors(self.problem.robot, q, self.problem.target)
        squared = error * error
        away, turned = np.sqrt(squared[:, :3].sum(1)), np.sqrt(squared[:, 3:].sum(1))
        r, J = error * _WEIGHTS, J * _WEIGHTS[:, None]
        Jt = np.swapaxes(J, 1, 2)
        b = len(q)
        lanes = _Lanes(
            q=q,
            cost=(r * r).sum(1),
            gradient=-(Jt @ r[..., None])[..., 0],
            hessian=Jt @ J,
            away=away,
            turned=turned,
            gap=np.full(b, np.inf),
            culprit=np.full((b, 3), -1),
        )
        if self._engine is not None:
            wanted = self.problem.tolerances.safety_margin
            contacts = self._engine.contacts(q, wanted + HINGE_MARGIN)
            if len(contacts):
                forgiven = self._forgiven[contacts.row, contacts.sphere]
                own = contacts.other_sphere >= 0
                forgiven[own] += self._forgiven[contacts.row[own], contacts.other_sphere[own]]
                _add_hinges(lanes, contacts, contacts.gap + forgiven - wanted)
        return lanes

    def _step(self, lanes: _Lanes, damping: Array) -> Array:
        """Damped Gauss-Newton steps in the joints that are not held at a limit by the gradient."""
        held = ((lanes.q <= self._lower) & (lanes.gradient > 0)) | (
            (lanes.q >= self._upper) & (lanes.gradient < 0)
        )
        free = ~held
        n = lanes.q.shape[1]
        H = lanes.hessian * (free[:, :, None] & free[:, None, :])
        diagonal = np.arange(n)
        H[:, diagonal, diagonal] += (damping * np.sqrt(lanes.cost))[:, None] + held + 1e-12
        step = -np.linalg.solve(H, (lanes.gradient * free)[..., None])[..., 0]
        longest = np.abs(step).max(axis=1, keepdims=True)
        step *= np.minimum(1.0, LONGEST_STEP / np.maximum(longest, 1e-300))
        return np.clip(lanes.q + step, self._lower, self._upper)


def _add_hinges(lanes: _Lanes, contacts: Contacts, gap: Array) -> None:
    """Add max(0, margin - gap)^2 of every pair to the cost, and its derivatives."""
    short = HINGE_WEIGHT * np.maximum(HINGE_MARGIN - gap, 0.0)
    rates = HINGE_WEIGHT * contacts.gradient
    lane = contacts.row
    first = np.flatnonzero(np.diff(lane, prepend=-1))
    rows = lane[first]
    lanes.cost[rows] += np.add.reduceat(short * short, first)
    lanes.gradient[rows] -= np.add.reduceat(short[:, None] * rates, first)
    active = rates * (short > 0)[:, None]
    lanes.hessian[rows] += np.add.reduceat(active[:, :, None] * active[:, None, :], first)
    lanes.gap[rows] = np.minimum.reduceat(gap, first)
    worst = np.flatnonzero(gap == lanes.gap[lane])
    lanes.culprit[lane[worst], 0] = contacts.sphere[worst]
    lanes.culprit[lane[worst], 1] = contacts.obstacle[worst]
    lanes.culprit[lane[worst], 2] = contacts.other_sphere[worst]
