"""Models of a fixed, or mocap, geom and another one that is free, of random kinds and sizes."""

import mujoco
import numpy as np

CONVEX = ("sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh")


def numbers(values):
    return " ".join(str(float(v)) for v in np.ravel(values))


def hill(rng, shape=None):
    """A height field's asset."""
    rows, columns = rng.integers(2, 14, 2) if shape is None else shape
    heights = rng.random((rows, columns)) * (rng.random((rows, columns)) < rng.uniform(0.2, 1))
    size = [*rng.uniform(0.2, 1, 2), rng.uniform(0.05, 0.6), rng.uniform(0.01, 0.3)]
    return (
        f'<hfield name="hill" nrow="{rows}" ncol="{columns}" size="{numbers(size)}" '
        f'elevation="{numbers(heights)}"/>'
    )


def pair_model(rng, first, second, option="", sizes=None):
    """A model of two geoms, the first on a mocap body and the second free, with small and large sizes."""
    sizes = 10 ** rng.uniform(-3, 0, (2, 3)) if sizes is None else sizes
    assets, bodies = hill(rng), []
    for kind, size, joint in zip((first, second), sizes, ("", "<freejoint/>"), strict=True):
        name = f"geom{len(bodies)}"
        what = {"mesh": f'mesh="{name}"', "hfield": 'hfield="hill"'}.get(kind, f'size="{numbers(size)}"')
        if kind == "mesh":
            points = rng.normal(size=(rng.integers(5, 40), 3)) * size
            assets += f'<mesh name="{name}" vertex="{numbers(points)}"/>'
        mass = '<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>' if joint else ""
        mocap = "" if joint else 'mocap="true"'
        bodies.append(f'<body {mocap}>{joint}{mass}<geom name="{name}" type="{kind}" {what}/></body>')
    return mujoco.MjModel.from_xml_string(
        f"<mujoco>{option}<asset>{assets}</asset><worldbody>{''.join(bodies)}</worldbody></mujoco>"
    )


def quaternion(rng):
    values = rng.normal(size=4)
    return values / np.linalg.norm(values)


def scatter(model, data, rng, reach):
    """Both somewhere, not farther than `reach` metres from the origin or so."""
    data.mocap_pos[:], data.mocap_quat[:] = rng.normal(size=3) * reach, quaternion(rng)
    data.qpos[:3], data.qpos[3:] = rng.normal(size=3) * reach, quaternion(rng)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
