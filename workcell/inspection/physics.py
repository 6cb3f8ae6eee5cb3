"""Options that change forces or distances, actuators that can't be driven, and what MuJoCo itself warns of."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from workcell.inspection.findings import Finding, beware, wrong
from workcell.model.loading.actuators import servo_range, undriven_because

if TYPE_CHECKING:
    import mujoco

    from workcell.model.scene import Scene

_FORCES = ("gravity", "wind", "magnetic", "density", "viscosity")
_SOLVING = ("impratio", "o_margin", "o_solref", "o_solimp", "o_friction")
_DISTANCES = ("ccd_tolerance", "ccd_iterations")


def option_findings(model: mujoco.MjModel) -> Iterator[Finding]:
    """What stands in `<option>` and is not MuJoCo's own choice, with what depends on it."""
    import mujoco

    plain = mujoco.MjOption()
    for names, words in (
        (_FORCES, "torques and simulated motions follow it"),
        (_DISTANCES, "simulated contacts follow it; whether a configuration is clear is judged without it"),
    ):
        for name in names:
            value = getattr(model.opt, name)
            if not np.array_equal(np.asarray(value), np.asarray(getattr(plain, name))):
                told = np.asarray(value).tolist()
                yield beware("option", f'option {name}="{_listed(told)}": {words}', option=name, value=told)
    yield from _flags(int(model.opt.disableflags), "mjtDisableBit", "mjDSBL_", "disabled")
    yield from _flags(int(model.opt.enableflags), "mjtEnableBit", "mjENBL_", "enabled")


def _flags(bits: int, kind: str, prefix: str, word: str) -> Iterator[Finding]:
    import mujoco

    known = getattr(mujoco, kind).__members__
    for name, value in known.items():
        if name.startswith(prefix) and bits & int(value):
            flag = name.removeprefix(prefix).lower()
            yield beware(
                "option",
                f"{flag} is {word}: simulated motions follow it; whether a configuration is clear is judged without it"
                if flag != "filterparent"
                else "filterparent is disabled: links count as colliding with the links that carry them",
                option=flag,
                value=word,
            )


def _listed(value: object) -> str:
    return " ".join(f"{v:g}" for v in value) if isinstance(value, list) else f"{value:g}"


def actuator_findings(scene: Scene) -> Iterator[Finding]:
    """Actuators of robots' joints that no controller can drive, or not as far as the joint goes."""
    model = scene.model
    for robot in scene.robots.values():
        for k, actuator in enumerate(map(int, robot.actuator_ids)):
            held = servo_range(model, actuator) if actuator >= 0 else None
            low, high = robot.robot.joint_limits[k]
            if held is not None and (held[0] > low or held[1] < high):
                yield beware(
                    "actuator",
                    f"the servo {model.actuator(actuator).name!r} of {robot.name} holds its joint within "
                    f"[{held[0]:.4f}, {held[1]:.4f}] (ctrlrange), the joint goes from {low:.4f} to {high:.4f}: "
                    "tasks stay within both",
                    actuator=model.actuator(actuator).name, robot=robot.name,
                )  # fmt: skip
            reason = undriven_because(model, actuator) if actuator >= 0 else None
            if reason is not None:
                name = model.actuator(actuator).name
                yield wrong(
                    "actuator",
                    f"the actuator {name!r} of {robot.name} can't be driven: {reason}. Motions can be planned, but not "
                    "executed: use <motor>, <position> or <velocity>",
                    actuator=name, robot=robot.name,
                )  # fmt: skip


def warning_findings(scene: Scene) -> Iterator[Finding]:
    """What MuJoCo warned of while it compiled the files."""
    for text in scene.warnings:
        yield beware("warning", f"MuJoCo warns: {text}", warning=text)
