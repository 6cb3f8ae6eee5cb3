"""The pairs that are looked at are those that MuJoCo's own collision pipeline can bring into contact, no other."""

import itertools

import mujoco
import numpy as np
import pytest

from workcell.model.judge.pairs import colliding_pairs

MASKS = [1, 1, 1, 2, 3, 0]


class Generator:
    """Models of nested bodies: free, jointed, welded and mocap ones, spheres with bit masks, excludes and pairs.

    The margin is so large that every pair of spheres that may meet is in contact.
    """

    def __init__(self, seed):
        self.rng, self.bodies, self.geoms = np.random.default_rng(seed), 0, 0

    def geom(self, kind="sphere"):
        self.geoms += 1
        type_, affinity = self.rng.choice(MASKS, 2)
        masks = f'contype="{type_}" conaffinity="{affinity}"'
        return f'<geom name="g{self.geoms}" type="{kind}" size=".1 .1 .1" margin="20" {masks}/>'

    def body(self, depth=0):
        kinds = ["hinge", "none", "slide"] + ["free", "mocap"] * (depth == 0)
        kind, self.bodies = self.rng.choice(kinds), self.bodies + 1
        name = f"b{self.bodies}"
        place = " ".join(map(str, self.rng.uniform(-0.5, 0.5, 3)))
        mocap = 'mocap="true"' if kind == "mocap" else ""
        inside = {"free": "<freejoint/>", "hinge": "<joint/>", "slide": '<joint type="slide"/>'}.get(kind, "")
        if inside:
            inside += '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        static = kind in ("none", "mocap") and depth == 0
        for _ in range(self.rng.integers(0, 3)):
            inside += self.geom(self.rng.choice(["sphere", "plane"]) if static else "sphere")
        if depth < 3:
            inside += "".join(self.body(depth + 1) for _ in range(self.rng.choice([0, 0, 1, 2])))
        return f'<body name="{name}" {mocap} pos="{place}">{inside}</body>'

    def contacts(self):
        text = ""
        for _ in range(3 * (self.geoms > 1)):
            a, b = self.rng.choice(self.geoms, 2, replace=False) + 1
            text += f'<pair geom1="g{a}" geom2="g{b}" margin="20"/>'
        for _ in range(3 * (self.bodies > 1)):
            a, b = self.rng.choice(self.bodies, 2, replace=False) + 1
            text += f'<exclude body1="b{a}" body2="b{b}"/>'
        return f"<contact>{text}</contact>"

    def model(self):
        world = "".join(
            self.geom(self.rng.choice(["sphere", "plane"])) for _ in range(self.rng.integers(0, 3))
        )
        world += "".join(self.body() for _ in range(4))
        flag = self.rng.choice(["enable", "disable"])
        option = f'<option><flag filterparent="{flag}"/></option>'
        xml = f'<mujoco><size memory="50M"/>{option}<worldbody>{world}</worldbody>{self.contacts()}</mujoco>'
        return mujoco.MjModel.from_xml_string(xml)


@pytest.mark.parametrize("seed", range(60))
def test_the_pairs_are_mujocos_own(seed):
    model = Generator(seed).model()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    try:
        mujoco.mj_collision(model, data)
    except mujoco.FatalError:
        pytest.skip("so many planes on bodies are more than MuJoCo's own broad phase can take")
    met = {tuple(sorted(map(int, geoms))) for geoms in data.contact.geom}
    assert set(map(tuple, colliding_pairs(model, range(model.nbody)).tolist())) == met


def test_one_geom_of_each_pair_is_of_a_body_that_moves_and_none_of_one_ignored():
    model = Generator(7).model()
    body, every = model.geom_bodyid, colliding_pairs(model, range(model.nbody)).tolist()
    some, absent = set(range(1, model.nbody, 2)), {3, 4}
    expected = [
        pair
        for pair in every
        if any(int(body[g]) in some for g in pair) and not any(int(body[g]) in absent for g in pair)
    ]
    assert colliding_pairs(model, some, absent).tolist() == expected


def test_height_fields_and_planes_meet_neither():
    kinds = {"hfield": 'hfield="h"', "plane": 'size="1 1 1"', "box": 'size=".1 .1 .1"'}
    for first, second in itertools.combinations_with_replacement(kinds, 2):
        if second == "plane":  # only where nothing moves
            first, second = second, first
        free = '<freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>' if second != "plane" else ""
        model = mujoco.MjModel.from_xml_string(
            '<mujoco><asset><hfield name="h" nrow="3" ncol="3" size="1 1 1 1"/></asset><worldbody>'
            f'<body mocap="true"><geom type="{first}" {kinds[first]}/></body>'
            f'<body>{free}<geom type="{second}" {kinds[second]}/></body></worldbody></mujoco>'
        )
        assert len(colliding_pairs(model, range(model.nbody))) == ("box" in (first, second))
