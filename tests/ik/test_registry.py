"""The registry: what it names is there, takes what it says, and one entry makes a solver known everywhere."""

from types import MappingProxyType

import numpy as np
import pytest

from tests.ik.arms import planar, random_arm
from workcell.cli.parser import build_parser
from workcell.errors import InputError
from workcell.ik import registry
from workcell.ik.problem import Budget, IKProblem
from workcell.ik.registry import ALL_GOALS, PROOFS, SOLVERS, SolverEntry, auto_turns, load, takers
from workcell.ik.result import Candidate
from workcell.ik.solve import solve


@pytest.mark.parametrize("name", SOLVERS)
def test_every_function_of_a_solver_is_there(name):
    entry = SOLVERS[name]
    for function in filter(None, (entry.run, entry.prepare, entry.resumes)):
        assert callable(load(function)), function
    assert entry.help and not entry.help.endswith(".")


@pytest.mark.parametrize("name", PROOFS)
def test_every_function_of_a_kind_of_proof_is_there(name):
    for function in filter(None, (PROOFS[name].check, PROOFS[name].obstacles)):
        assert callable(load(function)), function


@pytest.mark.parametrize("name", [name for name, entry in SOLVERS.items() if entry.listed])
@pytest.mark.parametrize("goal", ALL_GOALS)
@pytest.mark.parametrize("sliding", [False, True])
def test_a_solver_takes_the_goals_and_joints_that_its_entry_says(name, goal, sliding):
    robot = random_arm(np.random.default_rng(7), n=7, sliding=sliding)
    assert bool(np.any(robot.prismatic)) is sliding
    target = robot.fk(robot.random_configuration(np.random.default_rng(1)))
    problem, entry = IKProblem(robot, target, goal=goal), SOLVERS[name]
    if goal in entry.goals and (entry.slides or not sliding):
        solve(problem, name, Budget(0.05))
    else:
        with pytest.raises(InputError, match="branch"):  # who takes everything is named
            solve(problem, name, Budget(0.05))


def test_the_portfolio_names_solvers_that_take_its_goal():
    for dof in (6, 7):
        for goal in ALL_GOALS:
            turns = auto_turns(dof, goal)
            assert turns and all(goal in SOLVERS[turn.solver].goals for turn in turns)


def elbow(problem: IKProblem, budget: Budget, seed: int) -> Candidate:
    """Knows one configuration by heart."""
    return Candidate(q=np.array([0.3, 0.8]))


def test_one_entry_makes_a_solver_known_everywhere(monkeypatch):
    entry = SolverEntry(help="knows one configuration by heart", run=f"{__name__}:elbow")
    monkeypatch.setattr(registry, "SOLVERS", MappingProxyType({**SOLVERS, "elbow": entry}))
    monkeypatch.setattr("workcell.ik.solve.SOLVERS", registry.SOLVERS)
    monkeypatch.setattr("workcell.ik.portfolio.SOLVERS", registry.SOLVERS)
    robot = planar()
    answer = solve(IKProblem(robot, robot.fk(np.array([0.3, 0.8]))), "elbow")
    assert answer.solved and answer.solver == "elbow" and "elbow.cpu_s" in answer.stats
    assert not solve(IKProblem(robot, robot.fk(np.zeros(2))), "elbow").solved
    assert "elbow" in takers() and "elbow" in registry.solver_names()
    for command in ("ik", "solve"):
        help_text = build_parser()._subparsers._group_actions[0].choices[command].format_help()
        assert "knows one configuration by heart" in " ".join(help_text.split())
