"""Equality constraints that close loops, as points that must coincide and sums of joints that must be kept."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from workcell.pose import Array, Pose

if TYPE_CHECKING:
    import mujoco

_LEVER = 0.1
"""Metres between the points of a weld, which weighs a turn of its frames against a shift."""


@dataclass(frozen=True, slots=True)
class Element:
    """One equality constraint.

    Attributes:
        name: for messages, such as `connect 'c' (rod, bracket)`.
        joints: ids of the joints that it depends on.
        bodies: the two bodies (ids) whose points must coincide; (-1, -1) for a tendon's.
        points: (2, k, 3) in the frames of the two bodies: one of a connect, three of a weld.
        multiples: (len(joints),) of a tendon's: the sum of multiples of joints that must be `total`.
        total: what the sum must be.
        unsupported: why its demands can't be looked at, in words; empty where they can.
        id: of the equality constraint in the compiled model.
    """

    name: str
    joints: tuple[int, ...]
    bodies: tuple[int, int] = (-1, -1)
    points: Array | None = None
    multiples: Array | None = None
    total: float = 0.0
    unsupported: str = ""
    id: int = -1

    @property
    def rows(self) -> int:
        """How many equations it is."""
        return 1 if self.points is None else 3 * self.points.shape[1]


def loop_elements(model: mujoco.MjModel) -> tuple[Element, ...]:
    """The active connects, welds, and equalities of tendons and flexes; couplings of single joints are none."""
    import mujoco

    kinds = mujoco.mjtEq
    found = []
    for equality in np.flatnonzero(model.eq_active0):
        kind = int(model.eq_type[equality])
        if kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            found.append(_of_bodies(model, int(equality), kind == kinds.mjEQ_WELD))
        elif kind == kinds.mjEQ_TENDON:
            found.append(_of_tendons(model, int(equality)))
        elif kind != kinds.mjEQ_JOINT:
            name = _name(model, int(equality), mujoco.mjtEq(kind).name.removeprefix("mjEQ_").lower(), ())
            found.append(Element(name, (), unsupported="deformable bodies", id=int(equality)))
    return tuple(found)


def joined(model: mujoco.MjModel, pairs: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(p,) whether geoms (p, 2) belong to bodies that a connect or weld joins: neighbours, as parent and child.

    Where the loop closes they overlap as geoms of parent and child do, whose contacts MuJoCo leaves out. As there the
    world is no neighbour, a `<pair>` counts, and a model may disable the filter.
    """
    import mujoco

    none = np.zeros(len(pairs), dtype=bool)
    if model.neq == 0 or model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT:
        return none
    weld = np.asarray(model.body_weldid)
    rigid = np.sort(weld[np.asarray(model.geom_bodyid)[pairs]], axis=1)
    explicit = {
        (min(a, b), max(a, b))
        for a, b in zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True)
    }
    for element in loop_elements(model):
        one, two = (
            sorted(int(weld[body]) for body in element.bodies) if element.points is not None else (0, 0)
        )
        if one != 0:
            none |= (rigid[:, 0] == one) & (rigid[:, 1] == two)
    wanted = np.array([(min(pair), max(pair)) not in explicit for pair in pairs.tolist()], dtype=bool)
    kept: NDArray[np.bool_] = none & wanted
    return kept


def _name(model: mujoco.MjModel, equality: int, kind: str, of: tuple[str, ...]) -> str:
    own = str(model.equality(equality).name)
    return kind + (f" {own!r}" if own else "") + (f" ({', '.join(of)})" if of else "")


def _of_bodies(model: mujoco.MjModel, equality: int, weld: bool) -> Element:
    import mujoco

    one, two = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
    data = np.array(model.eq_data[equality])
    if int(model.eq_objtype[equality]) == mujoco.mjtObj.mjOBJ_SITE:
        frames = [Pose(model.site_pos[site], model.site_quat[site]) for site in (one, two)]
        one, two = int(model.site_bodyid[one]), int(model.site_bodyid[two])
        turns = weld
    elif weld:
        frames = [Pose(data[3:6], data[6:10]), Pose.from_xyz(data[:3])]
        turns = data[10] != 0.0  # with a torquescale of zero it is a connect
    else:
        frames, turns = [Pose.from_xyz(data[:3]), Pose.from_xyz(data[3:6])], False
    local = _LEVER * np.eye(3)[[0, 1]] if turns else np.zeros((0, 3))
    corners = np.vstack([np.zeros(3), local])
    points = np.array([[frame.apply(corner) for corner in corners] for frame in frames])
    above = [set(joints_to(model, body)) for body in (one, two)]
    joints = tuple(sorted(above[0] ^ above[1]))
    name = _name(model, equality, "weld" if weld else "connect", (_body(model, one), _body(model, two)))
    return Element(name, joints, (one, two), points, id=equality)


def _body(model: mujoco.MjModel, body: int) -> str:
    return str(model.body(body).name) or f"body {body}"


def bodies_to(model: mujoco.MjModel, body: int) -> list[int]:
    """The bodies from the world's child down to one."""
    path = []
    while body > 0:
        path.append(body)
        body = int(model.body_parentid[body])
    return path[::-1]


def joints_on(model: mujoco.MjModel, body: int) -> range:
    """Ids of a body's own joints, in the order in which they move it."""
    first = max(int(model.body_jntadr[body]), 0)
    return range(first, first + int(model.body_jntnum[body]))


def joints_to(model: mujoco.MjModel, body: int) -> list[int]:
    """The joints that move a body, the first one first."""
    return [joint for one in bodies_to(model, body) for joint in joints_on(model, one)]


def _of_tendons(model: mujoco.MjModel, equality: int) -> Element:
    """A constraint on one tendon's length, or two tendons': of fixed tendons, a sum of multiples of joints."""

    tendons = [int(t) for t in (model.eq_obj1id[equality], model.eq_obj2id[equality]) if t >= 0]
    polynomial = np.array(model.eq_data[equality, :5])
    names = tuple(str(model.tendon(t).name) or f"tendon {t}" for t in tendons)
    name, sums = _name(model, equality, "tendon equality", names), dict[int, float]()
    through: set[int] = set()
    for tendon, sign in zip(tendons, (1.0, -float(polynomial[1])), strict=False):
        multiples_of, others = _wrapped(model, tendon)
        through |= others
        for joint, multiple in multiples_of.items():
            sums[joint] = sums.get(joint, 0.0) + sign * multiple
    listed = tuple(sorted({*sums, *through}))
    if through:
        return Element(name, listed, unsupported="tendons through space", id=equality)
    if len(tendons) > 1 and np.any(polynomial[2:]):
        return Element(
            name, listed, unsupported="tendons that follow each other by more than a multiple", id=equality
        )
    lengths = [float(model.tendon_length0[tendon]) for tendon in tendons]
    total = (
        lengths[0] + float(polynomial[0]) - (float(polynomial[1]) * lengths[1] if len(lengths) > 1 else 0.0)
    )
    multiples = np.array([sums[joint] for joint in listed])
    return Element(name, listed, multiples=multiples, total=total, id=equality)


@dataclass(frozen=True, slots=True)
class TendonLimit:
    """The limits of a tendon's length.

    Attributes:
        name: for messages.
        joints: ids of the joints that it depends on.
        multiples: (len(joints),) of a fixed tendon, whose length is a sum of multiples of joints; None: another one.
        lower, upper: of its length.
    """

    name: str
    joints: tuple[int, ...]
    multiples: Array | None
    lower: float
    upper: float


def tendon_limits(model: mujoco.MjModel) -> tuple[TendonLimit, ...]:
    """The limits of all tendons that have some."""
    found = []
    for tendon in np.flatnonzero(model.tendon_limited):
        sums, others = _wrapped(model, int(tendon))
        joints = tuple(sorted({*sums, *others}))
        multiples = None if others else np.array([sums[joint] for joint in joints])
        low, high = map(float, model.tendon_range[tendon])
        name = f"tendon {str(model.tendon(int(tendon)).name)!r}"
        found.append(TendonLimit(name, joints, multiples, low, high))
    return tuple(found)


def _wrapped(model: mujoco.MjModel, tendon: int) -> tuple[dict[int, float], set[int]]:
    """The multiples of joints that a tendon's length is, and the joints that move the sites that it runs through."""
    import mujoco

    sums, others = dict[int, float](), set[int]()
    first = int(model.tendon_adr[tendon])
    for wrap in range(first, first + int(model.tendon_num[tendon])):
        target = int(model.wrap_objid[wrap])
        if model.wrap_type[wrap] == mujoco.mjtWrap.mjWRAP_JOINT:
            sums[target] = sums.get(target, 0.0) + float(model.wrap_prm[wrap])
        elif model.wrap_type[wrap] == mujoco.mjtWrap.mjWRAP_SITE:
            others |= set(joints_to(model, int(model.site_bodyid[target])))
    return sums, others
