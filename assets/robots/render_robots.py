"""Draws the contact sheet of the robots: home pose from two sides, and again under the collision geometry.

    MUJOCO_GL=egl python assets/robots/render_robots.py [docs/images/robots.png]

Needs a way to render without a screen (egl or osmesa) and matplotlib.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import mujoco
import numpy as np
from numpy.typing import NDArray

ROBOTS = Path(__file__).resolve().parent
PICTURE = ROBOTS.parents[1] / "docs" / "images" / "robots.png"
ARMS = {"sawyer": "Sawyer, with the parallel gripper", "ur10": "UR10", "iiwa14": "LBR iiwa 14"}
FLOOR = {"sawyer": -0.92, "ur10": 0.0, "iiwa14": 0.0}
VIEWS = {
    "from the front": (-140.0, False),
    "from behind": (50.0, False),
    "collision geometry": (-140.0, True),
}
TILE = (420, 480)  # width, height of one picture in pixels

VISUAL_GROUP, COLLISION_GROUP = 2, 3


def studio(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The robot alone, at home on a floor under two lights."""
    arm = mujoco.MjSpec.from_file(str(ROBOTS / f"{name}.xml"))
    if name == "sawyer":
        hand = mujoco.MjSpec.from_file(str(ROBOTS / "parallel_gripper.xml"))
        arm.attach(hand, site="right_hand", prefix="gripper/")
        arm.compile()  # else MuJoCo warns that the keyframe of the arm may lose its prefix
    world = mujoco.MjSpec()
    world.visual.headlight.ambient = [0.45] * 3
    world.visual.headlight.diffuse = [0.4] * 3
    world.visual.global_.offwidth, world.visual.global_.offheight = TILE
    world.visual.quality.shadowsize = 4096
    plain = [0.86, 0.89, 0.92]
    world.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=plain,
        rgb2=plain,
        width=64,
        height=64,
    )
    sun = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    world.worldbody.add_light(
        type=sun, pos=[0.6, -0.8, 3], dir=[-0.6, 0.8, -3], diffuse=[0.35] * 3, castshadow=True
    )
    world.worldbody.add_light(type=sun, pos=[-2, 2, 3], dir=[2, -2, -3], diffuse=[0.2] * 3, castshadow=False)
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    world.worldbody.add_geom(
        type=plane, size=[20, 20, 0.1], pos=[0, 0, FLOOR[name] - 0.001], rgba=[0.8, 0.82, 0.85, 1]
    )
    world.worldbody.add_site(name="mount")
    world.attach(arm, site="mount", prefix=f"{name}/")
    model = world.compile()
    model.geom_size[model.geom_group == COLLISION_GROUP] += (
        0.002  # for the eye: not in one plane with the visuals
    )
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    sliding = model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
    data.qpos[model.jnt_qposadr[sliding]] = model.jnt_range[sliding, 1]  # the fingers, open
    mujoco.mj_forward(model, data)
    return model, data


def extent(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[NDArray[np.float64], float]:
    """Centre and radius of what is to be seen: the box around the bounding spheres of the collision geometry."""
    shown = model.geom_group == COLLISION_GROUP
    reach = np.minimum(model.geom_rbound[shown], 0.2)[:, None]
    low, high = (data.geom_xpos[shown] - reach).min(axis=0), (data.geom_xpos[shown] + reach).max(axis=0)
    return (low + high) / 2, float(np.linalg.norm(high - low)) / 2


def picture(name: str, azimuth: float, collision: bool) -> NDArray[np.uint8]:
    """One view of one robot."""
    model, data = studio(name)
    camera = mujoco.MjvCamera()
    centre, radius = extent(model, data)
    camera.lookat[:], camera.distance = centre, 2.35 * radius
    camera.azimuth, camera.elevation = azimuth, -14.0
    option = mujoco.MjvOption()
    option.geomgroup[:] = 0
    option.geomgroup[[0, VISUAL_GROUP]] = 1
    option.geomgroup[COLLISION_GROUP] = collision
    with mujoco.Renderer(model, height=TILE[1], width=TILE[0]) as renderer:
        renderer.update_scene(data, camera, option)
        return np.asarray(renderer.render())


def contact_sheet(path: Path) -> None:
    """All robots, one row a view, as PNG."""
    figure, axes = plt.subplots(len(VIEWS), len(ARMS), figsize=(9, 10.2), dpi=110, layout="constrained")
    for row, (view, (azimuth, collision)) in zip(axes, VIEWS.items(), strict=True):
        for axis, (name, title) in zip(row, ARMS.items(), strict=True):
            axis.imshow(picture(name, azimuth, collision))
            axis.set(xticks=[], yticks=[])
            axis.spines[:].set_visible(False)
            if axis is row[0]:
                axis.set_ylabel(view)
            if row is axes[0]:
                axis.set_title(title, fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, pil_kwargs={"optimize": True})
    plt.close(figure)


if __name__ == "__main__":
    contact_sheet(Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURE)
