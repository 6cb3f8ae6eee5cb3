"""The command line's grammar. Commands are imported when they run, so that `--help` stays quick."""

from __future__ import annotations

import argparse

from workcell.cli import values
from workcell.cli.arguments import Commands, command, json_option, late, seed_option
from workcell.cli.solving_grammar import add_bench, add_solving
from workcell.ik.registry import planner_names

_EXIT_CODES = """\
exit codes: 0 done and achieved; 1 ran, but not achieved; 2 bad input; 3 proved impossible; \
70 unforeseen, with a file to report; 130 interrupted"""


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
    add_solving(commands)
    add_bench(commands)
    _add_running(commands)
    return parser


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


def _add_models(commands: Commands) -> None:
    robots = command(
        commands, "robots", "list the robots that travel with workcell", "robots", late("models", "robots")
    )
    json_option(robots)

    check = command(
        commands,
        "check",
        "validate a robot, cell, task or problem-set file: what it contains, what is wrong and where",
        "check tasks/shelf_grasp.toml",
        late("models", "check"),
    )
    check.add_argument(
        "file", metavar="FILE", help="a robot, cell or task (name or path), or a problem set (.json)"
    )
    json_option(check)

    decompose = command(
        commands,
        "decompose",
        "cover robot and obstacles with spheres and free space with cuboids and polytopes, with their quality",
        "decompose shelf --robot sawyer --png shelf.png",
        late("models", "decompose"),
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
        help="write which sphere can be in which cuboid, for later planning "
        "(`load_table` of workcell.geometry.free_space.admissible reads it)",
    )
    decompose.add_argument(
        "--rrd",
        type=values.file_name,
        metavar="FILE",
        help="record geometry, spheres and free space for Rerun",
    )
    seed_option(decompose)
    json_option(decompose)


def _add_running(commands: Commands) -> None:
    run = command(
        commands,
        "run",
        "plan a task, execute it in MuJoCo and record it",
        "run shelf_grasp --seed 3 --out runs/third",
        late("running", "run"),
    )
    run.add_argument("task", metavar="TASK", help="a task's name, or the path of its .toml or .py")
    run.add_argument("--robot", metavar="R", help="another robot, where the task suits several")
    run.add_argument(
        "--planner",
        default="ikspark",
        metavar="NAME",
        help=f"solver of the configurations and the path: {', '.join(planner_names())} (default: ikspark); "
        "the other solvers answer single poses (`solve --solver`), and plan no motion",
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
    run.add_argument(
        "--trace",
        type=values.file_name,
        metavar="FILE",
        help="recorded poses that a task such as teleop follows, in place of its own: CSV or JSON lines",
    )
    run.add_argument(
        "--view",
        action="store_true",
        help="watch a task whose tools follow goals in a window, and drag their targets with the mouse",
    )
    seed_option(run)
    json_option(run)

    review = command(
        commands,
        "review",
        "read a recording back without a screen: verdict, metrics, pictures",
        "review runs/shelf_grasp/shelf_grasp.rrd --png runs/shelf_grasp",
        late("running", "review"),
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
    json_option(review)
