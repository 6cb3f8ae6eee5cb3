"""What a compiled model's equality constraints say of single joints: which are locked."""

from __future__ import annotations

from typing import TYPE_CHECKING

from workcell.errors import ModelError
from workcell.model.robot import LIMIT_SLACK

if TYPE_CHECKING:
    import mujoco


def locked_values(model: mujoco.MjModel) -> dict[int, float]:
    """Joints (ids) that an equality constraint of their own holds at one value, and that value.

    Constraints that are inactive at the start don't count.

    Raises:
        ModelError: two that contradict each other.
    """
    import mujoco

    held: dict[int, float] = {}
    for equality in range(model.neq):
        alone = model.eq_type[equality] == mujoco.mjtEq.mjEQ_JOINT and int(model.eq_obj2id[equality]) < 0
        if not alone or not model.eq_active0[equality]:
            continue
        joint = int(model.eq_obj1id[equality])
        value = float(model.qpos0[model.jnt_qposadr[joint]] + model.eq_data[equality, 0])
        if abs(held.setdefault(joint, value) - value) > LIMIT_SLACK:
            raise ModelError(
                f"two equality constraints hold joint {model.joint(joint).name!r} at {held[joint]:g} and {value:g}"
            )
    return held
