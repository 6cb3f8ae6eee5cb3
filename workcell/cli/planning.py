"""`plan`: collision-free paths for problem sets."""

from __future__ import annotations

import argparse
from pathlib import Path

from workcell.cli import exit_codes
from workcell.cli.output import busy, check_outputs, print_json, print_table, progress_bar, tell
from workcell.compile_ahead import SAMPLING, compile_ahead


def plan(options: argparse.Namespace) -> int:
    """A whole problem set; exit 0 when every problem was processed."""
    from workcell.ik.problem import Budget
    from workcell.motion.plans.compiled import Effort
    from workcell.sets.planning import plan_set
    from workcell.sets.problems import load_problem_set

    compile_ahead(SAMPLING)
    with busy(f"reading {options.set}"):
        problem_set = load_problem_set(Path(options.set))
    effort = Effort(optimise_s=options.optimise_s)
    if options.optimise_iterations is not None:
        effort = Effort(
            optimise_s=options.optimise_s or float("inf"), optimise_iterations=options.optimise_iterations
        )
    check_outputs([options.out], [options.set])
    out = Path(options.out) if options.out else None
    with progress_bar(f"plan {Path(options.set).name}", len(problem_set.problems)) as bar:
        summary = plan_set(
            problem_set,
            budget=Budget(options.budget_s),
            effort=effort,
            seed=options.seed,
            jobs=options.jobs,
            out=out,
            progress=bar.step,
        )
    if options.json:
        print_json(summary.to_json())
    else:
        print_table(Path(options.set).name, ["", "value"], summary.rows())
        if out:
            tell(f"wrote {out}")
    return exit_codes.DONE
