"""`robots`, `check` and `decompose`: what there is, and whether it is sound."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workcell.cli import exit_codes
from workcell.cli.output import busy, check_outputs, print_json, print_table, progress_bar, tell
from workcell.errors import InputError, ModelError, UnknownNameError

if TYPE_CHECKING:
    import mujoco

    from workcell.model.robot import Robot
    from workcell.model.scene import Scene

_PARTS = ("robot cover", "obstacle cover", "cuboids", "polytopes", "table of pairs", "measurement")
"""Of a decomposition, in the order in which they are made."""


def robots(options: argparse.Namespace) -> int:
    """Table of the robots that travel with workcell."""
    from workcell.model.loading.assets import list_assets

    rows = [_row(name) for name in list_assets("robots")]
    if options.json:
        print_json(rows)
    else:
        header = ["name", "kind", "dof", "reach m", "tools", "spheres (2 cm)", "source"]
        cells = [[", ".join(v) if isinstance(v, list) else v for v in row.values()] for row in rows]
        print_table("Robots", header, cells)
    return exit_codes.DONE


def _row(name: str) -> dict[str, Any]:
    from workcell.geometry.covers.outer import model_cover
    from workcell.model.loading.assets import find_asset
    from workcell.model.loading.compiled import is_gripper, robot_from_model
    from workcell.model.loading.load import compile_spec, load_spec

    path = find_asset("robots", name)
    model = compile_spec(load_spec(path), path)
    if is_gripper(model):
        tools = [model.site(site).name for site in range(model.nsite)]
        return _fields(name, "gripper", 0, None, tools, None, path)
    robot = robot_from_model(model, name=name, where=path)
    spheres = len(model_cover(model, robot, overshoot=0.02))
    return _fields(name, "arm", robot.dof, round(robot.reach(), 3), list(robot.tools), spheres, path)


def _fields(
    name: str, kind: str, dof: int, reach_m: float | None, tools: list[str], spheres: int | None, source: Path
) -> dict[str, Any]:
    return {
        "name": name,
        "kind": kind,
        "dof": dof,
        "reach_m": reach_m,
        "tools": tools,
        "spheres": spheres,
        "source": str(source),
    }


def check(options: argparse.Namespace) -> int:
    """Validate one file and say what it contains."""
    contents_of = _check_problem_set if options.file.endswith(".json") else _check_model
    with busy(f"reading {options.file}"):
        contents = contents_of(options.file)
    problems = contents["problems"]
    if options.json:
        print_json(contents)
    else:
        tell(f"{contents['file']}: {contents['kind']}")
        for line in contents["contents"]:
            tell(f"  {line}")
        for line in contents.get("beware", ()):
            tell(f"  BEWARE  {line}")
        for line in problems:
            tell(f"  WRONG  {line}")
        tell("nothing wrong" if not problems else f"{len(problems)} thing(s) wrong")
    return exit_codes.DONE if not problems else exit_codes.BAD_INPUT


def _check_problem_set(path: str) -> dict[str, Any]:
    from workcell.sets.problems import load_problem_set

    problem_set = load_problem_set(Path(path))
    lines = [
        f"robot {problem_set.robot.name}: {problem_set.robot.dof} joints, {len(problem_set.cover)} spheres",
        f"{len(problem_set.problems)} problems, {sum(p.start is not None for p in problem_set.problems)} with a start",
    ]
    return {"file": path, "kind": "problem set", "contents": lines, "problems": []}


def _check_model(name: str) -> dict[str, Any]:
    from workcell.model.loading.assets import list_assets

    bare_robot = name in list_assets("robots")
    if not bare_robot:
        try:
            return _check_scene(name)
        except UnknownNameError as error:
            if error.kind == "task or cell":
                raise UnknownNameError(
                    "robot, cell or task", name, [*error.known, *list_assets("robots")]
                ) from None
            raise
    return _check_robot(name)


def _check_robot(name: str) -> dict[str, Any]:
    from workcell.model.loading.assets import find_asset
    from workcell.model.loading.compiled import is_gripper
    from workcell.model.loading.load import compile_spec, load_spec
    from workcell.model.scene import robot_scene

    path = find_asset("robots", name)
    model = compile_spec(load_spec(path), path)
    if is_gripper(model):
        return _check_gripper(name, model, path)
    scene = robot_scene(name)
    return _found(scene, name, "robot", _robot_lines(scene.robot().robot), [])


def _check_gripper(name: str, model: mujoco.MjModel, path: Path) -> dict[str, Any]:
    """A hand without an arm: its sites, and the mechanism that it is."""
    sites = ", ".join(model.site(site).name for site in range(model.nsite))
    return _found_alone(name, "gripper", model, path, [f"tools {sites}"], [])


def _found_alone(
    file: str, kind: str, model: mujoco.MjModel, path: Path, lines: list[str], also: list[str]
) -> dict[str, Any]:
    """What `check` says of a model in which there is no robot to be found: the mechanism that it is."""
    from workcell.inspection.findings import texts
    from workcell.inspection.mechanisms import mechanism_findings
    from workcell.model.mechanism.from_model import mechanism_of

    try:
        found = tuple(mechanism_findings(mechanism_of(model, where=path), serial=False))
    except ModelError as error:
        found = tuple(mechanism_findings(error, serial=False))
    return {
        "file": file,
        "kind": kind,
        "contents": [*lines, *texts(found, "fact")],
        "beware": [*also, *texts(found, "beware")],
        "problems": texts(found, "wrong"),
        "findings": [finding.to_json() for finding in found],
    }


def _found(scene: Scene, file: str, kind: str, lines: list[str], problems: list[str]) -> dict[str, Any]:
    """What `check` says: `lines`, and everything that the inspection finds."""
    from workcell.inspection.findings import texts
    from workcell.inspection.inspect import inspect_scene

    findings = inspect_scene(scene)
    return {
        "file": file,
        "kind": kind,
        "contents": [*lines, *texts(findings, "fact")],
        "beware": texts(findings, "beware"),
        "problems": [*problems, *texts(findings, "wrong")],
        "findings": [finding.to_json() for finding in findings],
    }


def _robot_lines(robot: Robot) -> list[str]:
    lines = [f"{robot.name}: {robot.dof} joints, reach {robot.reach():.3f} m, tools {', '.join(robot.tools)}"]
    unlimited = [
        joint for joint, limit in zip(robot.joint_names, robot.acceleration, strict=True) if limit == math.inf
    ]
    if unlimited:
        lines.append(
            f"no acceleration limit, which timed motions need: {', '.join(unlimited)} "
            f'(<custom><numeric name="{unlimited[0]}:acceleration" data="..."/></custom> in MJCF, '
            "or acceleration= in the task's script)"
        )
    return lines


def _mechanism_alone(name: str, refusal: ModelError) -> dict[str, Any] | None:
    """A model file in which no robot is found, as the mechanism that it is; None where it is none that ties close."""
    from workcell.model.loading.assets import is_path
    from workcell.model.loading.load import compile_spec, load_spec
    from workcell.model.mechanism.from_model import mechanism_of

    if not is_path(name) or name.endswith(".toml"):
        return None
    try:
        model = compile_spec(load_spec(name, kind="cells"), name)
        mechanism = mechanism_of(model, where=name)
    except ModelError:
        return None
    if not mechanism.closures:
        return None
    return _found_alone(
        name, "mechanism", model, Path(name), [], [f"no robot is found in it: {refusal.message}"]
    )


def _check_scene(name: str) -> dict[str, Any]:
    from workcell.model.scene import Scene

    try:
        scene = Scene.load(name)
    except ModelError as error:
        if (alone := _mechanism_alone(name, error)) is None:
            raise
        return alone
    if scene.path.suffix != ".toml" and len(scene.robots) == 1 and not scene.obstacles:
        lines = _robot_lines(replace(scene.robot().robot, name=scene.name))
        return _found(scene, name, "robot", lines, _scene_problems(scene))
    lines = [f"obstacles: {', '.join(_standing(scene)) or 'none'}"]
    lines += [
        f"object {thing.name}: {'free' if thing.qpos_address is not None else 'fixed'}"
        for thing in scene.objects.values()
    ]
    for robot in scene.robots.values():
        gripper = f", gripper {robot.gripper}" if robot.gripper else ""
        lines.append(
            f"robot {robot.name}: {robot.robot.dof} joints, tool {robot.robot.default_tool}{gripper}"
        )
    lines += [
        f"goal {goal.name}: {goal.robot} at {_numbers(goal.pose.position)} quat {_numbers(goal.pose.quat_wxyz)}"
        for goal in scene.goals.values()
    ]
    return _found(scene, str(scene.path), "scene", lines, _scene_problems(scene))


def _standing(scene: Scene) -> list[str]:
    """Names of the obstacles; where there is no robot, what moves is none."""
    from workcell.inspection.mechanisms import moved_bodies, scene_mechanism_of

    mechanism = None if scene.robots else scene_mechanism_of(scene)
    if mechanism is None or isinstance(mechanism, ModelError):
        return list(scene.obstacles)
    moving = {str(scene.model.body(body).name) for body in moved_bodies(mechanism)}
    return [name for name in scene.obstacles if name not in moving]


def _scene_problems(scene: Scene) -> list[str]:
    import mujoco

    from workcell.model.loading.actuators import actuated_joints
    from workcell.model.loading.compiled import is_gripper
    from workcell.model.overlap import mechanism_overlap, start_overlap

    problems = []
    model = scene.model
    moving = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
    joints = [
        model.joint(j).name or f"number {j}" for j in range(model.njnt) if int(model.jnt_type[j]) in moving
    ]
    idle = not actuated_joints(model) and not is_gripper(model)
    if joints and idle and not scene.robots and scene.mechanism is None:
        problems.append(
            f"no joint is actuated, so that there is no robot: {', '.join(joints)}; "
            "add an <actuator> with a <motor joint=...> for every joint that workcell may move"
        )
    for name in scene.robots:
        if overlap := start_overlap(scene, name):
            what, remedy = overlap
            problems.append(f"robot {name} starts in collision: {what}; {remedy}")
    if scene.mechanism is not None and (told := mechanism_overlap(scene.mechanism)):
        problems.append(f"mechanism {scene.mechanism.name} starts in collision: {told}")
    return problems


def _numbers(values: Any) -> str:
    return "[" + ", ".join(f"{value:.4f}" for value in values) + "]"


def decompose(options: argparse.Namespace) -> int:
    """Sphere covers and free-space cuboids of a cell, with their quality."""
    from workcell.files import write_json_atomic
    from workcell.geometry.decompose import decompose as run
    from workcell.model.scene import Scene

    with busy(f"loading {options.cell}"):
        scene, name = Scene.load(options.cell), options.robot
        if name is not None and name not in scene.robots:
            scene, name = Scene.load(options.cell, robot=name), None
    if options.table and name is None and not scene.robots:
        raise InputError(
            "there is no robot whose spheres could be in cuboids", where="table", remedy="mount one: --robot"
        )
    check_outputs((options.out, options.png, options.rrd, options.table), (options.cell, options.robot))
    with progress_bar("decompose", len(_PARTS), _PARTS) as bar:
        result = run(scene, name, overshoot=options.overshoot, seed=options.seed, progress=bar.step)
    document = result.to_json()
    if options.out:
        write_json_atomic(Path(options.out), document)
    if options.png:
        from workcell.record.show.decomposition import draw_decomposition

        draw_decomposition(result, Path(options.png))
    if options.rrd:
        from workcell.record.write.decomposition import record_decomposition

        record_decomposition(result, scene, Path(options.rrd))
    if options.table and result.robot is not None:
        from workcell.geometry.free_space.admissible import save_table

        save_table(options.table, result.robot, result.robot_cover, result.free_space)
    if options.json:
        print_json(document)
    else:
        rows = [metric_words(name, value) for name, value in document["metrics"].items()]
        print_table(f"Decomposition of {scene.name}", ["metric", "value"], rows)
        for path in (options.out, options.png, options.rrd, options.table):
            if path:
                tell(f"wrote {path}")
    return exit_codes.DONE


def metric_words(name: str, value: Any) -> tuple[str, str]:
    """A metric's name without its unit, and its value with it."""
    words = name.removesuffix("_s").removesuffix("_m").replace("_", " ")
    if value is None:
        return words, "-"
    if isinstance(value, bool):
        return words, "yes" if value else "NO"
    if isinstance(value, list):
        return words, ", ".join(map(str, value)) or "none"
    if name.endswith("_fraction"):
        return words, f"{100 * value:.1f} %"
    if name.endswith("_s"):
        return words, f"{value:.2f} s"
    if name.endswith("_m"):
        return words, f"{1e3 * value:.2f} mm" if value < 0.1 else f"{value:.2f} m"
    return words, str(value)
