"""Links are where MuJoCo has them, ties miss what MuJoCo says that they miss, and derivatives are what they are."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tests.model.mechanism.trees import compiled, data_at, random_q, random_tree, words
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.placing import difference, missed, moved, place
from workcell.pose import Pose, quat_to_matrix

SEEDS = range(12)


def tree(seed, **options):
    rng = np.random.default_rng(seed)
    model = compiled(random_tree(rng, **options))
    moving = [model.joint(joint).name for joint in range(model.njnt)]
    return mechanism_of(model, moving=moving), rng


@pytest.mark.parametrize("seed", SEEDS)
def test_links_and_frames_are_where_mujoco_has_them(seed):
    mechanism, rng = tree(seed)
    compiled_in = mechanism.compiled
    model = compiled_in.model
    for _ in range(5):
        q = random_q(mechanism, rng)
        data, placed = data_at(mechanism, q), place(mechanism, q)
        for body in range(model.nbody):
            link, T = compiled_in.link_of_body[body], compiled_in.T_link_body[body]
            np.testing.assert_allclose(placed.point(link, T.position), data.xpos[body], atol=1e-12)
            np.testing.assert_allclose(placed.R[link] @ T.rotation, data.xmat[body].reshape(3, 3), atol=1e-12)
        for site in range(model.nsite):
            frame = mechanism.frame(model.site(site).name)
            where = placed.point(frame.link, frame.T_link_frame.position)
            np.testing.assert_allclose(where, data.site_xpos[site], atol=1e-12)
            R = placed.R[frame.link] @ frame.T_link_frame.rotation
            np.testing.assert_allclose(R, data.site_xmat[site].reshape(3, 3), atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_columns_are_mujoco_s(seed):
    mechanism, rng = tree(seed)
    model = mechanism.compiled.model
    q = random_q(mechanism, rng)
    data, placed = data_at(mechanism, q), place(mechanism, q)
    dofs = np.concatenate([model.jnt_dofadr[j.id] + np.arange(r.stop - r.start)
                           for j, r in zip(mechanism.joints, mechanism.rate_slices, strict=True)])  # fmt: skip
    for body in range(1, model.nbody):
        point, linear, angular = rng.normal(size=3), np.zeros((3, model.nv)), np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, linear, angular, point, body)
        ours = placed.columns(int(mechanism.compiled.link_of_body[body]), point)
        np.testing.assert_allclose(ours[0], linear[:, dofs], atol=1e-12)
        np.testing.assert_allclose(ours[1], angular[:, dofs], atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_difference_leads_back(seed):
    mechanism, rng = tree(seed)
    q, other = random_q(mechanism, rng), random_q(mechanism, rng)
    reached = moved(mechanism, q, difference(mechanism, q, other))
    for joint, at in zip(mechanism.joints, mechanism.value_slices, strict=True):
        if joint.kind in ("ball", "free"):
            one, two = (quat_to_matrix(values[at.stop - 4 : at.stop]) for values in (reached, other))
            np.testing.assert_allclose(one, two, atol=1e-9)
            at = slice(at.start, at.stop - 4)
        np.testing.assert_allclose(reached[at], other[at], atol=1e-12)
    tangent = rng.uniform(-1, 1, mechanism.dof)
    np.testing.assert_allclose(difference(mechanism, q, moved(mechanism, q, tangent)), tangent, atol=1e-9)


def test_a_tangent_is_mujoco_s_velocity():
    mechanism, rng = tree(3)
    model, q, tangent = mechanism.compiled.model, None, rng.normal(size=mechanism.dof)
    q = random_q(mechanism, rng)
    qpos, qvel = mechanism.compiled.qpos(q), np.zeros(model.nv)
    for joint, rate in zip(mechanism.joints, mechanism.rate_slices, strict=True):
        first = model.jnt_dofadr[joint.id]
        qvel[first : first + rate.stop - rate.start] = tangent[rate]
    mujoco.mj_integratePos(model, qpos, qvel, 1.0)
    np.testing.assert_allclose(mechanism.compiled.qpos(moved(mechanism, q, tangent)), qpos, atol=1e-12)


EQUALITIES = """
<connect name="c" body1="b1" body2="b4" anchor=".1 .2 -.1"/>
<weld name="w" body1="b2" body2="b5" anchor=".1 0 .3" relpose=".1 .2 .3 .5 .5 -.5 .5"/>
<connect name="cs" site1="s3" site2="s6"/>
<weld name="ws" site1="s0" site2="s7"/>
<weld name="fixed" body1="b3" relpose="0 0 1 1 0 0 0"/>
"""


@pytest.mark.parametrize("seed", SEEDS)
def test_ties_miss_what_mujoco_says(seed):
    mechanism, rng = tree(seed, equality=EQUALITIES)
    q = random_q(mechanism, rng)
    data = data_at(mechanism, q)
    values, k = missed(place(mechanism, q))[0], 0
    assert len(mechanism.closures) > 2
    for closure in mechanism.closures:
        rows = (data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY) & (data.efc_id == closure.id)
        found = data.efc_pos[rows]
        np.testing.assert_allclose(np.linalg.norm(values[k : k + 3]), np.linalg.norm(found[:3]), atol=1e-12)
        k += 3
        if closure.kind == "weld":
            angle = np.linalg.norm(values[k : k + 3])
            np.testing.assert_allclose(np.sin(0.5 * angle), np.linalg.norm(found[3:]), atol=1e-9)
            k += 3


@pytest.mark.parametrize("seed", SEEDS)
def test_derivatives_of_ties_by_differences_where_they_are_kept(seed):
    mechanism, rng = tree(seed, equality=EQUALITIES)
    q = random_q(mechanism, rng)
    closed, placed = [], place(mechanism, q)
    for closure in mechanism.closures:  # the same ties, with frames that coincide here
        (a, b), F = closure.links, closure.frames[0]
        T = [Pose.from_rotation(placed.p[link], placed.R[link]) for link in (a, b)]
        closed.append(replace(closure, frames=(F, T[1].inverse() @ T[0] @ F)))
    mechanism = replace(mechanism, closures=tuple(closed))
    value, rows = missed(place(mechanism, q))
    np.testing.assert_allclose(value, 0.0, atol=1e-9)
    for column in range(mechanism.dof):
        step = np.zeros(mechanism.dof)
        step[column] = 1e-5
        ahead, back = (missed(place(mechanism, moved(mechanism, q, s)))[0] for s in (step, -step))
        np.testing.assert_allclose((ahead - back) / 2e-5, rows[:, column], atol=1e-7)


COUPLED = """<mujoco><compiler angle="radian"/><worldbody>
  <body><joint name="a" axis="0 0 1" ref=".2"/><geom size=".1"/>
    <body><joint name="b" axis="0 1 0" ref="-.3"/><geom size=".1"/>
      <body pos="1 0 0"><joint name="c" type="slide" axis="1 0 0" ref=".1"/><geom size=".1"/></body></body></body>
  </worldbody>
  <tendon><fixed name="t"><joint joint="a" coef="2"/><joint joint="c" coef="-1"/></fixed></tendon>
  <equality><joint joint1="b" joint2="a" polycoef=".1 -.5 .2 .03 -.01"/><tendon tendon1="t" polycoef=".2"/></equality>
</mujoco>"""


def test_followers_and_sums_miss_what_mujoco_says():
    mechanism, rng = mechanism_of(compiled(COUPLED)), np.random.default_rng(0)
    for _ in range(5):
        q = rng.normal(size=3)
        data = data_at(mechanism, q)
        value, rows = missed(place(mechanism, q))
        held = data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
        np.testing.assert_allclose(value, held, atol=1e-12)
        for column in range(3):
            step = 1e-5 * np.eye(3)[column]
            ahead, back = (missed(place(mechanism, q + s))[0] for s in (step, -step))
            np.testing.assert_allclose((ahead - back) / 2e-5, rows[:, column], atol=1e-7)


def test_points_of_many_links_are_those_of_each():
    mechanism, rng = tree(5)
    placed = place(mechanism, random_q(mechanism, rng))
    links, local = np.arange(mechanism.link_count), rng.normal(size=(mechanism.link_count, 3))
    points = placed.points(links, local)
    linear, angular = placed.jacobians(links, points)
    for link in links:
        np.testing.assert_allclose(points[link], placed.point(link, local[link]), atol=1e-13)
        one = placed.columns(link, points[link])
        np.testing.assert_allclose(linear[link], one[0], atol=1e-13)
        np.testing.assert_allclose(angular[link], one[1], atol=1e-13)


def test_what_stays_stands_where_it_begins():
    rng = np.random.default_rng(2)
    model = compiled(random_tree(rng, free=False))
    names = [model.joint(joint).name for joint in range(model.njnt)]
    qpos = mechanism_of(model, moving=names)
    qpos = qpos.compiled.qpos(random_q(qpos, rng))
    mechanism = mechanism_of(model, qpos=qpos, moving=names[::2])
    assert [joint.name for joint in mechanism.joints] == names[::2]
    q = random_q(mechanism, rng)
    data, placed = data_at(mechanism, q), place(mechanism, q)
    for body in range(model.nbody):
        link, T = mechanism.compiled.link_of_body[body], mechanism.compiled.T_link_body[body]
        np.testing.assert_allclose(placed.point(link, T.position), data.xpos[body], atol=1e-12)


def test_words_are_exact():
    assert [float(word) for word in words([0.1, 1 / 3]).split()] == [0.1, 1 / 3]
