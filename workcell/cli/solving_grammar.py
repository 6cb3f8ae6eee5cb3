"""The grammar of `ik`, `solve`, `plan`, `verify` and `bench`."""

from __future__ import annotations

import argparse
import re

from workcell.cli import values
from workcell.cli.arguments import (
    Commands,
    budget_option,
    command,
    jobs_option,
    json_option,
    late,
    seed_option,
)
from workcell.ik.registry import solvers_in_words


def add_solving(commands: Commands) -> None:
    """`ik`, `solve`, `plan` and `verify`."""
    _add_ik(commands)
    _add_solve(commands)
    _add_plan(commands)
    _add_verify(commands)


def _add_ik(commands: Commands) -> None:
    ik = command(
        commands,
        "ik",
        "answer one inverse-kinematics query in words",
        "ik sawyer --pose 0.6 0.1 0.4 0 1 0 0",
        late("solving", "ik"),
    )
    ik.add_argument(
        "robot",
        metavar="ROBOT",
        help="a robot's name or model file; in a task, the name of one of its robots; a cell or task, whose joints are "
        "all asked",
    )
    ik.add_argument(
        "--pose",
        nargs=7,
        type=float,
        metavar=("X", "Y", "Z", "QW", "QX", "QY", "QZ"),
        help="wanted world pose of the tool",
    )
    ik.add_argument(
        "--goals",
        metavar="FILE.toml",
        help="several goals, regions and contacts at once (format workcell-goals/1), in place of --pose",
    )
    ik.add_argument(
        "--mechanism",
        action="store_true",
        help="ask all joints of the model, as is done where it is no serial robot: loops, ball joints, several arms",
    )
    ik.add_argument(
        "--closest",
        action="store_true",
        help="the configuration of a mechanism that comes closest to goals out of reach, with a bound that is proved",
    )
    ik.add_argument(
        "--form",
        choices=("quaternion", "rotation"),
        help="of ikspark's lift of rotations, for mechanisms (default: quaternion)",
    )
    # argparse alone takes -1e-3 for an option
    ik._negative_number_matcher = re.compile(r"^-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$|^-(inf|nan)$")
    ik.add_argument("--tool", metavar="SITE", help="the site to place (default: the robot's tool)")
    ik.add_argument(
        "--cell",
        metavar="CELL",
        help="a cell or task with obstacles; a cell alone gets ROBOT at its site robot_mount, or at the origin",
    )
    ik.add_argument(
        "--goal",
        choices=("pose", "position", "axis"),
        default="pose",
        help="what of the pose counts: all, the position, or it and the z axis' direction (default: pose)",
    )
    ik.add_argument("--no-why", action="store_true", help='don\'t explain a proved "no" (it takes seconds)')
    _solver_options(ik)
    json_option(ik)


def _add_solve(commands: Commands) -> None:
    solve = command(
        commands,
        "solve",
        "solve a problem-set file",
        "solve sawyer_workcell.json --solver ikspark --out answers.jsonl",
        late("solving", "solve"),
    )
    solve.add_argument("set", metavar="SET.json", help="a problem set (format workcell-ikset/1)")
    _solver_options(solve)
    jobs_option(solve)
    solve.add_argument(
        "--out",
        type=values.file_name,
        metavar="ANSWERS.jsonl",
        help="write one JSON line a problem; without it only the table is printed",
    )
    json_option(solve)


def _add_plan(commands: Commands) -> None:
    plan = command(
        commands,
        "plan",
        "plan collision-free, proved paths for the problems of a set",
        "plan panda_mbm_box.json --budget-s 1 --out paths.jsonl",
        late("planning", "plan"),
    )
    plan.add_argument("set", metavar="SET.json", help="a problem set whose problems have a start")
    budget_option(plan)
    plan.add_argument(
        "--optimise-s",
        type=values.seconds,
        default=0.0,
        metavar="S",
        help="CPU seconds a problem to spend on shorter and shorter paths, on top of the budget (default: 0)",
    )
    plan.add_argument(
        "--optimise-iterations",
        type=values.positive_int,
        default=None,
        metavar="N",
        help="samples to draw for that, at most; without --optimise-s they alone count, and a seed gives one path",
    )
    jobs_option(plan)
    plan.add_argument(
        "--out",
        type=values.file_name,
        metavar="PATHS.jsonl",
        help="write one JSON line a problem; without it only the table is printed",
    )
    seed_option(plan)
    json_option(plan)


def _add_verify(commands: Commands) -> None:
    verify = command(
        commands,
        "verify",
        "re-check the answers, certificates and paths of a problem set without any solver",
        "verify sawyer_workcell.json answers.jsonl",
        late("verifying", "verify"),
    )
    verify.add_argument(
        "set", metavar="SET.json", nargs="?", help="the problems; --explain alone does without"
    )
    verify.add_argument("answers", metavar="ANSWERS.jsonl", nargs="?", help="what `solve` or `plan` wrote")
    verify.add_argument(
        "--exact",
        action="store_true",
        help="ask the second checker, in exact arithmetic, about trees of boxes too: up to some seconds a proof",
    )
    verify.add_argument(
        "--explain",
        metavar="FILE",
        help="show a certificate, or those of an answer file, in words: what is claimed, by which rule, what it rests "
        "on; with SET.json, whether it holds",
    )
    json_option(verify)


def add_bench(commands: Commands) -> None:
    """`bench`."""
    bench = command(
        commands,
        "bench",
        "measure a table of ours or of a paper again",
        "bench ikspark-free --n 200 --out ikspark_free.json",
        late("solving", "bench"),
    )
    bench.add_argument("bench", metavar="NAME", nargs="?", help="see --list")
    bench.add_argument("--list", action="store_true", help="list the benches")
    bench.add_argument(
        "--n", type=values.positive_int, metavar="N", help="problems a row (default: the bench's own)"
    )
    bench.add_argument(
        "--sets", metavar="DIR", help="folder of problem-set files, for the benches that run them"
    )
    bench.add_argument(
        "--seeds", type=values.positive_int, default=1, metavar="N", help="run N seeds and report the worst"
    )
    jobs_option(bench)
    bench.add_argument("--out", type=values.file_name, metavar="FILE", help="write the rows as JSON")
    seed_option(bench)
    json_option(bench)


def _solver_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--solver",
        default="auto",
        metavar="NAME",
        help=f"{solvers_in_words()} (default: auto)",
    )
    budget_option(parser)
    seed_option(parser)
