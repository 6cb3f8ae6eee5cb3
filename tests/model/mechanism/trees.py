"""Random trees of bodies with joints of every kind, and what ties them, as MJCF texts."""

import mujoco
import numpy as np


def words(values):
    return " ".join(map(repr, np.asarray(values, dtype=float).ravel().tolist()))


def unit(rng, size):
    v = rng.normal(size=size)
    return v / np.linalg.norm(v)


def random_tree(rng, bodies=8, equality="", joints=("hinge", "slide", "ball"), free=True):
    """A tree of bodies, each with a geom, a site and none to three joints, some with anchors, refs and ranges."""
    parents = [-1] + [int(rng.integers(-1, k)) for k in range(1, bodies)]
    texts = []
    for k in range(bodies):
        own = ""
        if free and parents[k] < 0 and k > 0 and rng.uniform() < 0.5:
            own = f'<freejoint name="j{k}"/>'
        else:
            kinds = list(rng.choice(joints, size=rng.integers(0 if k and not equality else 1, 4)))
            if "ball" in kinds:  # MuJoCo takes no rotation after a ball
                kinds = [kind for kind in kinds if kind != "ball"] + ["ball"]
            for i, kind in enumerate(kinds):
                limits = ""
                if kind == "ball":
                    limits = f'range="0 {rng.uniform(1, 3)}"' if rng.uniform() < 0.5 else ""
                else:
                    limits = f'axis="{words(rng.normal(size=3))}" ref="{rng.uniform(-1, 1)}"'
                    if rng.uniform() < 0.5:
                        limits += f' range="{rng.uniform(-2, -1)} {rng.uniform(1, 2)}"'
                own += f'<joint name="j{k}_{i}" type="{kind}" pos="{words(rng.normal(size=3))}" {limits}/>'
        texts.append(
            f'<body name="b{k}" pos="{words(rng.normal(size=3))}" quat="{words(unit(rng, 4))}">{own}'
            f'<geom type="sphere" size=".05" pos="{words(rng.normal(size=3))}"/>'
            f'<site name="s{k}" pos="{words(rng.normal(size=3))}" quat="{words(unit(rng, 4))}"/>'
        )

    def nested(parent):
        return "".join(texts[k] + nested(k) + "</body>" for k in range(bodies) if parents[k] == parent)

    return (
        f'<mujoco><compiler angle="radian"/><worldbody>{nested(-1)}</worldbody>'
        f"<equality>{equality}</equality></mujoco>"
    )


def compiled(text):
    return mujoco.MjModel.from_xml_string(text)


def random_q(mechanism, rng):
    q = rng.normal(size=mechanism.size)
    for joint, at in zip(mechanism.joints, mechanism.value_slices, strict=True):
        if joint.kind in ("ball", "free"):
            q[at.stop - 4 : at.stop] = unit(rng, 4)
    return q


def data_at(mechanism, q):
    """MuJoCo's own data with the mechanism at a configuration."""
    model = mechanism.compiled.model
    data = mujoco.MjData(model)
    data.qpos[:] = mechanism.compiled.qpos(q)
    mujoco.mj_forward(model, data)
    return data
