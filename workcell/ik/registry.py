"""Solvers and kinds of proof, each named once.

Here stands what `solve`, the portfolio, the checks and the command line know of them.

A solver is a room of its own under `workcell.ik` and one entry in `SOLVERS`; a kind of proof is its checker and one
entry in `PROOFS`. Functions stand here by name ("module:function") and are imported when they are first called, since
solvers import heavy libraries; for the same reason nothing is imported here but types.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workcell.ik.problem import Budget, Goal, IKProblem
    from workcell.ik.result import Candidate

    Solver = Callable[[IKProblem, Budget, int], Candidate]

AUTO = "auto"
AUTO_HELP = "the others in turns, until an answer or a proof holds"
WHOLE_POSES: tuple[Goal, ...] = ("pose",)
ALL_GOALS: tuple[Goal, ...] = ("pose", "position", "axis")
_FOREVER = float("inf")
_ROUNDS = 12
"""Rounds of long turns in the portfolio, each twice as long as the one before: of some minutes all together."""


@dataclass(frozen=True, slots=True)
class Turn:
    """A solver's turn in the portfolio.

    Attributes:
        solver: whose turn it is.
        effort: the work after which it ends, in the seconds that it takes on a quiet core. It is counted and not timed
            (`Budget.effort`), so that whose turn is next depends on no clock.
        short: whether a longer one follows.
    """

    solver: str
    effort: float = _FOREVER
    short: bool = False


@dataclass(frozen=True, slots=True)
class Progress:
    """How far the portfolio has come when a turn is about to begin.

    Its problem, what the solvers counted ("SOLVER.COUNT"), and who has proved, in the conservative model
    alone, that there is no solution.
    """

    problem: IKProblem
    stats: Mapping[str, float]
    blocked_in_model_by: str | None


def _never(turn: Turn, progress: Progress) -> bool:
    return False


@dataclass(frozen=True, slots=True)
class SolverEntry:
    """What is known of a solver.

    Attributes:
        help: what it does, in a sentence.
        run: "module:function" that takes problem, budget and seed and returns a `Candidate`.
        options: keyword arguments of that function.
        work: what it does, as a stage of a query, where it tells no stages of its own.
        goals: which goals it takes.
        slides: whether it takes sliding joints.
        couples: whether it takes joints that follow others.
        prepare: "module:function" that takes the problem and compiles (or loads, or makes once for a scene) what the
            solver needs: no query's budget pays for that.
        resumes: "module:class" of a search that goes on where its last turn ended: made of a problem, with
            `run(deadline, budget)`; empty: every turn begins anew.
        is_futile: whether a turn can't find out more.
        plans: whether tasks can be planned with it (`--planner`): it alone answers every step of a tool path.
        within: the solver that it is a part of: it answers in its name, and says so; empty: it is one of its own.
        listed: whether users can name it.
    """

    help: str
    run: str
    options: Mapping[str, Any] = field(default_factory=dict)
    work: str = ""
    goals: tuple[Goal, ...] = WHOLE_POSES
    slides: bool = True
    couples: bool = True
    prepare: str = ""
    resumes: str = ""
    is_futile: Callable[[Turn, Progress], bool] = _never
    plans: bool = False
    within: str = ""
    listed: bool = True

    def solver(self) -> Solver:
        """The function that solves."""
        return partial(load(self.run), **self.options)


@dataclass(frozen=True, slots=True)
class ProofEntry:
    """What is known of a kind of proof.

    Attributes:
        check: "module:function" that takes problem and certificate and returns None, or why the proof does not hold.
        obstacles: "module:function" that takes a certificate and returns the indices of the problem's obstacles that it
            uses; empty: it doesn't say.
        goals: which goals it can be about.
    """

    check: str
    obstacles: str = ""
    goals: tuple[Goal, ...] = WHOLE_POSES


def load(name: str) -> Any:
    """The function or class of "module:name", imported now."""
    module, _, attribute = name.partition(":")
    return getattr(importlib.import_module(module), attribute)


def _sampled_enough(turn: Turn, progress: Progress) -> bool:
    """A short search that has seen all that short ones can."""
    return turn.short and progress.stats.get("hjcd.exhausted", 0.0) > 0.0


def _searched_through(turn: Turn, progress: Progress) -> bool:
    """Branch and bound is through with the conservative model."""
    return progress.blocked_in_model_by == "branch"


def _not_yet_inside(turn: Turn, progress: Progress) -> bool:
    """Inside is only asked where the model around the geometry is known to be too large, or time gets short."""
    return progress.problem.inner is None or (progress.blocked_in_model_by is None and turn.short)


SOLVERS: Mapping[str, SolverEntry] = MappingProxyType(
    {
        "elementary": SolverEntry(
            help="bounds that prove what is plainly too far or plainly in collision",
            run="workcell.ik.elementary.solver:solve_elementary",
            work="elementary bounds",
            prepare="workcell.ik.elementary.solver:prepare",
            listed=False,
        ),
        "hjcd": SolverEntry(
            help="sampling, polished and slid clear of obstacles",
            run="workcell.ik.hjcd.solver:solve_hjcd",
            work="sampling",
            prepare="workcell.ik.hjcd.solver:prepare",
            is_futile=_sampled_enough,
        ),
        "branch": SolverEntry(
            help="branch and bound over the joints, with proofs",
            run="workcell.ik.branch.solver:solve_branch",
            work="branch and bound",
            goals=ALL_GOALS,
            prepare="workcell.ik.branch.solver:prepare",
            resumes="workcell.ik.branch.solver:BranchSearch",
            is_futile=_searched_through,
        ),
        "inside": SolverEntry(
            help="branch and bound on a model inside the real geometry, whose proofs hold of that geometry",
            run="workcell.ik.branch.inside:solve_inside",
            work="branch and bound inside",
            prepare="workcell.ik.branch.inside:prepare",
            resumes="workcell.ik.branch.inside:InsideSearch",
            is_futile=_not_yet_inside,
            listed=False,
        ),
        "multistart": SolverEntry(
            help="local search from random starts, the baseline",
            run="workcell.ik.multistart.solver:solve_multistart",
            work="local search",
        ),
        "ikspark": SolverEntry(
            help="convex: lifted rotations driven to rank 1, every sphere in a free-space cuboid, with proofs",
            run="workcell.ik.ikspark.solver:solve_ikspark",
            goals=ALL_GOALS,
            prepare="workcell.ik.shared.convex:prepare",
            plans=True,
        ),
        "ikspark+cuts": SolverEntry(
            help="its fallback: half-spaces where spheres collide instead of cuboids",
            run="workcell.ik.ikspark.solver:solve_ikspark",
            goals=ALL_GOALS,
            prepare="workcell.ik.shared.convex:prepare",
            options={"cuboids": False},
            within="ikspark",
        ),
        "ikspark+lm": SolverEntry(
            help="ikspark with local descent besides",
            run="workcell.ik.ikspark.solver:solve_ikspark",
            prepare="workcell.ik.shared.convex:prepare",
            options={"local": True},
            slides=False,
            couples=False,
        ),
        "cidgik": SolverEntry(
            help="convex: distances between points driven to rank 3, with proofs",
            run="workcell.ik.cidgik.solver:solve_cidgik",
            prepare="workcell.ik.cidgik.solver:prepare",
            goals=ALL_GOALS,
            slides=False,
            couples=False,
            plans=True,
        ),
        "cidgik+planes": SolverEntry(
            help="with planes that touch the obstacles instead of spheres that cover them",
            run="workcell.ik.cidgik.solver:solve_cidgik",
            prepare="workcell.ik.cidgik.solver:prepare",
            options={"tangent": True},
            goals=ALL_GOALS,
            slides=False,
            couples=False,
            within="cidgik",
        ),
        "cidgik+lm": SolverEntry(
            help="with local descent besides",
            run="workcell.ik.cidgik.solver:solve_cidgik",
            prepare="workcell.ik.cidgik.solver:prepare",
            options={"local": True},
            goals=ALL_GOALS,
            slides=False,
            couples=False,
        ),
    }
)
"""Every solver, by the name that users and the portfolio give it."""

PROOFS: Mapping[str, ProofEntry] = MappingProxyType(
    {
        "branch": ProofEntry(
            check="workcell.ik.branch.checker.check:check_branch",
            obstacles="workcell.ik.branch.checker.check:obstacles_used",
            goals=ALL_GOALS,
        ),
        "cidgik": ProofEntry(check="workcell.ik.cidgik.check:old_cidgik", goals=ALL_GOALS),
        "cidgik/2": ProofEntry(check="workcell.ik.cidgik.check:check_cidgik", goals=ALL_GOALS),
        "farkas": ProofEntry(check="workcell.ik.ikspark.check:old_farkas"),
        "farkas/2": ProofEntry(check="workcell.ik.ikspark.check:check_farkas"),
        "last_link": ProofEntry(
            check="workcell.ik.elementary.check:check_last_link",
            obstacles="workcell.ik.elementary.check:obstacles_used",
        ),
        "mechanism/1": ProofEntry(check="workcell.ik.mechanisms.of_problem:check_robot", goals=ALL_GOALS),
        "reach": ProofEntry(check="workcell.ik.elementary.check:check_reach"),
        "solution": ProofEntry(check="workcell.ik.solution.check:check_solution"),
    }
)
"""Every kind of certificate, by its name."""


def auto_turns(dof: int, goal: Goal) -> tuple[Turn, ...]:
    """Turns of `auto`.

    Nearly all problems that have a solution fall to the first samples, nearly all others to branch and bound,
    which ends in a proof; what resists both gets longer and longer turns of everybody, so that nobody waits long for
    the others.
    """
    if goal not in WHOLE_POSES:
        return (Turn("branch"),)
    return (
        Turn("elementary", 0.0),
        # Six joints have few configurations: two milliseconds tell, and branch and bound needs but a few more.
        Turn("hjcd", 0.002 if dof <= 6 else 0.003, short=True),
        Turn("branch", 0.01, short=True),
        Turn("hjcd", 0.006, short=True),
        Turn("branch", 0.06, short=True),
        Turn("hjcd", 0.03, short=True),
        Turn("inside", 1.0, short=True),
        *(turn for k in range(_ROUNDS) for turn in _long_turns(2.0**k)),
        Turn("hjcd"),
    )


def _long_turns(scale: float) -> tuple[Turn, ...]:
    """One after the other, in the shares that their chances are worth."""
    return (
        Turn("branch", 0.2 * scale),
        Turn("inside", 0.1 * scale),
        Turn("ikspark", 0.04 * scale),
        Turn("hjcd", 0.05 * scale),
    )


def solver_names() -> tuple[str, ...]:
    """Names that `solve` takes."""
    return (AUTO, *(name for name, entry in SOLVERS.items() if entry.listed))


def planner_names() -> tuple[str, ...]:
    """Names that tasks can be planned with."""
    return (*(name for name, entry in SOLVERS.items() if entry.plans), AUTO)


def plans_alone(name: str) -> bool:
    """Whether every step of a tool path is that solver's own; with others it is tracked locally."""
    return name in SOLVERS and SOLVERS[name].plans


def is_planned_by(planner: str, solver: str) -> bool:
    """Whether an answer by `solver` is one of `planner`: its own, or that of a part of it; all answers are `auto`'s."""
    return planner in (AUTO, solver) or (solver in SOLVERS and SOLVERS[solver].within == planner)


def takers(*, goal: Goal = "pose", slides: bool = False, couples: bool = False, word: str = "and") -> str:
    """The solvers that take such a goal, and sliding or coupled joints where asked for, as a list in words."""
    able = [
        name
        for name, entry in SOLVERS.items()
        if entry.listed
        and goal in entry.goals
        and (entry.slides or not slides)
        and (entry.couples or not couples)
    ]
    return f"{', '.join([AUTO, *able[:-1]])} {word} {able[-1]}"


def solvers_in_words() -> str:
    """Every name with its sentence, for help texts."""
    listed = {AUTO: AUTO_HELP} | {name: entry.help for name, entry in SOLVERS.items() if entry.listed}
    return ", ".join(f"{name} ({words})" for name, words in listed.items())
