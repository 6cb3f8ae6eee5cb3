"""The command line's grammar. Commands are imported when they run, so that `--help` stays quick."""

from __future__ import annotations

import argparse
import importlib
import re
from collections.abc import Callable

from workcell.cli import values

Command = Callable[[argparse.Namespace], int]

_EXIT_CODES = """\
exit codes: 0 done and achieved; 1 ran, but not achieved; 2 bad input; 3 proved impossible; 130 interrupted"""


def build_parser() -> argparse.ArgumentParser:
    """The whole grammar."""
    parser = argparse.ArgumentParser(
        prog="workcell",
        description="Verified inverse kinematics, planning, simulation and recordings for robot cells.",
        epilog=f"example: workcell run shelf_grasp\n\n{_EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show program's version number and exit")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, dest="name")
    _add_models(commands)
    _add_solving(commands)
    _add_bench(commands)
    _add_running(commands)
    return parser


class _Help(argparse.HelpFormatter):
    """Examples stay on one line, to be pasted."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith("example: ") else super()._fill_text(text, width, indent)


class _Version(argparse.Action):
    """Looks the version up when it is asked for, which takes longer than everything else here."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import PackageNotFoundError, version

        try:
            found = version("workcell")
        except PackageNotFoundError:
            found = "unknown"
        print(f"{parser.prog} {found}")
        parser.exit()


def _late(module: str, function: str) -> Command:
    """A command that imports its module only when it runs."""

    def call(options: argparse.Namespace) -> int:
        code: int = getattr(importlib.import_module(f"workcell.cli.{module}"), function)(options)
        return code

    return call


def _command(
    commands: argparse._SubParsersAction[argparse.ArgumentParser],
    name: str,
    help_text: str,
    example: str,
    run: Command,
) -> argparse.ArgumentParser:
    parser = commands.add_parser(
        name,
        help=help_text,
        description=help_text[0].upper() + help_text[1:] + ".",
        epilog=f"example: workcell {example}",
        formatter_class=_Help,
    )
    parser.set_defaults(command=run, parser=parser)
    return parser


def _json_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of text")


def _seed_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--seed", type=values.count, default=0, metavar="N", help="same seed, same answer (default: 0)"
    )


def _add_models(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    robots = _command(
        commands, "robots", "list the robots that travel with workcell", "robots", _late("models", "robots")
    )
    _json_option(robots)

    check = _command(
        commands,
        "check",
        "validate a robot, cell, task or problem-set file: what it contains, what is wrong and where",
        "check tasks/shelf_grasp.toml",
        _late("models", "check"),
    )
    check.add_argument(
        "file", metavar="FILE", help="a robot, cell or task (name or path), or a problem set (.json)"
    )
    _json_option(check)

    decompose = _command(
        commands,
        "decompose",
        "cover robot and obstacles with spheres and free space with cuboids and polytopes, with their quality",
        "decompose shelf --robot sawyer --png shelf.png",
        _late("models", "decompose"),
    )
    decompose.add_argument("cell", metavar="CELL", help="a cell or task (name or path)")
    decompose.add_argument(
        "--robot",
        metavar="R",
        help="one of the cell's robots; or one to mount in a cell that has none, at its site robot_mount or at the "
        "origin, and in place of a task's",
    )
    decompose.add_argument(
        "--overshoot",
        type=values.positive,
        default=0.02,
        metavar="M",
        help="of the spheres, metres (default: 0.02)",
    )
    decompose.add_argument(
        "--out", type=values.file_name, metavar="FILE", help="write spheres, cuboids and metrics as JSON"
    )
    decompose.add_argument(
        "--png", type=values.file_name, metavar="FILE", help="draw geometry, spheres and free space"
    )
    decompose.add_argument(
        "--table",
        type=values.file_name,
        metavar="FILE.npz",
        help="write which sphere can be in which cuboid, for later planning",
    )
    decompose.add_argument(
        "--rrd",
        type=values.file_name,
        metavar="FILE",
        help="record geometry, spheres and free space for Rerun",
    )
    _seed_option(decompose)
    _json_option(decompose)


def _add_solving(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    ik = _command(
        commands,
        "ik",
        "answer one inverse-kinematics query in words",
        "ik sawyer --pose 0.6 0.1 0.4 0 1 0 0",
        _late("solving", "ik"),
    )
    ik.add_argument(
        "robot",
        metavar="ROBOT",
        help="a robot's name or model file; in a task, the name of one of its robots",
    )
    ik.add_argument(
        "--pose",
        nargs=7,
        type=float,
        required=True,
        metavar=("X", "Y", "Z", "QW", "QX", "QY", "QZ"),
        help="wanted world pose of the tool",
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
    _json_option(ik)

    solve = _command(
        commands,
        "solve",
        "solve a problem-set file",
        "solve sawyer_workcell.json --solver ikspark --out answers.jsonl",
        _late("solving", "solve"),
    )
    solve.add_argument("set", metavar="SET.json", help="a problem set (format workcell-ikset/1)")
    _solver_options(solve)
    solve.add_argument(
        "--jobs", type=values.positive_int, default=1, metavar="N", help="processes (default: 1)"
    )
    solve.add_argument(
        "--out",
        type=values.file_name,
        metavar="ANSWERS.jsonl",
        help="write one JSON line a problem; without it only the table is printed",
    )
    _json_option(solve)

    plan = _command(
        commands,
        "plan",
        "plan collision-free, proved paths for the problems of a set",
        "plan panda_mbm_box.json --budget-s 1 --out paths.jsonl",
        _late("planning", "plan"),
    )
    plan.add_argument("set", metavar="SET.json", help="a problem set whose problems have a start")
    plan.add_argument(
        "--budget-s", type=values.seconds, default=5.0, metavar="S", help="CPU seconds a problem (default: 5)"
    )
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
    plan.add_argument(
        "--jobs", type=values.positive_int, default=1, metavar="N", help="processes (default: 1)"
    )
    plan.add_argument(
        "--out",
        type=values.file_name,
        metavar="PATHS.jsonl",
        help="write one JSON line a problem; without it only the table is printed",
    )
    _seed_option(plan)
    _json_option(plan)

    verify = _command(
        commands,
        "verify",
        "re-check the answers, certificates and paths of a problem set without any solver",
        "verify sawyer_workcell.json answers.jsonl",
        _late("solving", "verify"),
    )
    verify.add_argument("set", metavar="SET.json")
    verify.add_argument("answers", metavar="ANSWERS.jsonl", help="what `solve` or `plan` wrote")
    _json_option(verify)


def _add_bench(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    bench = _command(
        commands,
        "bench",
        "measure a table of ours or of a paper again",
        "bench ikspark-free --n 200 --out ikspark_free.json",
        _late("solving", "bench"),
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
    bench.add_argument(
        "--jobs", type=values.positive_int, default=1, metavar="N", help="processes (default 1)"
    )
    bench.add_argument("--out", type=values.file_name, metavar="FILE", help="write the rows as JSON")
    _seed_option(bench)
    _json_option(bench)


def _solver_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--solver",
        default="auto",
        metavar="NAME",
        help="auto, hjcd, branch, multistart, ikspark, ikspark+lm, cidgik, cidgik+lm (default: auto)",
    )
    parser.add_argument(
        "--budget-s", type=values.seconds, default=5.0, metavar="S", help="CPU seconds a problem (default: 5)"
    )
    _seed_option(parser)


def _add_running(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    run = _command(
        commands,
        "run",
        "plan a task, execute it in MuJoCo and record it",
        "run shelf_grasp --seed 3 --out runs/third",
        _late("running", "run"),
    )
    run.add_argument("task", metavar="TASK", help="a task's name, or the path of its .toml or .py")
    run.add_argument("--robot", metavar="R", help="another robot, where the task suits several")
    run.add_argument(
        "--planner",
        default="ikspark",
        metavar="NAME",
        help="solver of the configurations and the path: ikspark, cidgik or auto (default: ikspark)",
    )
    run.add_argument(
        "--controller",
        default="computed_torque",
        metavar="NAME",
        help="what drives the motors: computed_torque (default) or servo, a joint servo with feed-forward",
    )
    run.add_argument(
        "--out",
        type=values.file_name,
        metavar="DIR",
        help="folder of the recording and the summary (default: runs/TASK)",
    )
    _seed_option(run)
    _json_option(run)

    review = _command(
        commands,
        "review",
        "read a recording back without a screen: verdict, metrics, pictures",
        "review runs/shelf_grasp/shelf_grasp.rrd --png runs/shelf_grasp",
        _late("running", "review"),
    )
    review.add_argument("file", metavar="FILE.rrd", nargs="+", help="a recording; two with --compare")
    review.add_argument(
        "--png", type=values.file_name, metavar="DIR", help="write a contact sheet and plots there"
    )
    review.add_argument(
        "--html",
        type=values.file_name,
        metavar="FILE",
        help="write one page that holds everything, pictures too",
    )
    review.add_argument("--compare", action="store_true", help="say what differs between two recordings")
    _json_option(review)
