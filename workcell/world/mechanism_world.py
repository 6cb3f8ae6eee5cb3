"""`MechanismWorld`: a mechanism in its scene as solvers see it, with the compiled model behind it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from workcell.errors import InputError, UnknownNameError
from workcell.geometry.covers.mechanisms import apart_pairs, fitted_cover, mechanism_cover
from workcell.geometry.pieces import mechanism_pieces
from workcell.geometry.self_collision import SelfCollisionPairs
from workcell.geometry.types import Piece, SphereCover
from workcell.ik.mechanisms.goals import FrameGoal, InRegion
from workcell.ik.mechanisms.polish import polish_mechanism
from workcell.ik.mechanisms.problem import MechanismProblem, MechanismTolerances, UserConstraint
from workcell.ik.mechanisms.sampling import random_configuration, reach_of
from workcell.model.labels import geoms_called
from workcell.model.loading.assets import is_path, list_assets, list_tasks
from workcell.model.loading.load import compile_spec, load_spec
from workcell.model.mechanism.from_model import mechanism_of
from workcell.model.mechanism.measuring import MechanismMeasure, measure_of
from workcell.model.mechanism.mechanism import WORLD, Closure, Mechanism
from workcell.model.mechanism.walking import joint_label
from workcell.model.scene import Scene
from workcell.pose import Array, Pose

if TYPE_CHECKING:
    import mujoco

SAMPLES = 40
"""Configurations, ties kept where they can be, that tell which spheres always touch."""
_CLOSED = 1e-6
"""Metres (radians) that ties may miss in them."""


@dataclass(frozen=True, slots=True)
class Held:
    """A grasp: a floating body that moves with a frame of the mechanism, as if welded to it.

    Attributes:
        body: the name of the floating body.
        frame: the name of the frame that holds it, such as a tool.
        T_frame_body: how it stands in that frame; None: as it does where the scene begins.
    """

    body: str
    frame: str
    T_frame_body: Pose | None = None


@dataclass(frozen=True, slots=True)
class MechanismWorld:
    """What is known about a mechanism in its scene. Build one with `MechanismWorld.of`.

    Attributes:
        mechanism: what moves, grasps among its closures.
        cover: outer spheres of its links, made smaller where they touch and the compiled model, at home, does not; on
            link 0 those of what stands and may be touched by some, but not by all.
        obstacles: convex pieces of everything else that no joint moves, and the mechanism may hit.
        spheres: which spheres must keep apart, and which can't be told by spheres.
        touching: pairs of geoms that may touch.
        overshoot: of the cover, metres.
    """

    mechanism: Mechanism
    cover: SphereCover
    obstacles: tuple[Piece, ...]
    spheres: SelfCollisionPairs
    touching: tuple[tuple[str, str], ...] = ()
    overshoot: float = 0.02

    @staticmethod
    def of(
        scene: Scene | mujoco.MjModel | Mechanism | str | Path,
        *,
        qpos: ArrayLike | None = None,
        moving: Collection[str] | None = None,
        touching: Sequence[tuple[str, str]] = (),
        held: Sequence[Held] = (),
        overshoot: float = 0.02,
        samples: int = SAMPLES,
        seed: int = 0,
    ) -> MechanismWorld:
        """Cover what moves, and collect what it may hit.

        Args:
            scene: a scene, whose mechanism it is if its task names one; a compiled model; a mechanism that comes from
                one; or the name or path of a task, a cell or a robot.
            qpos: (nq,) raw positions of what does not move; None: where the scene begins.
            moving: names of the joints that move; None: as `mechanism_of`, and what is held.
            touching: pairs of geoms (names) that may touch: contacts that are asked for.
            held: grasps. A body that several frames hold closes a loop.
            overshoot: of the spheres, metres.
            samples: random configurations that tell which spheres always touch.
            seed: of these.

        Raises:
            ModelError: as `mechanism_of`, or a geom without a convex form; UnknownNameError: a joint, geom, body or
                frame that is not there; InputError: a body that is held but does not float.
        """
        mechanism = mechanism_in(scene, qpos=qpos, moving=moving, held=held)
        pairs = tuple((str(one), str(two)) for one, two in touching)
        return _world(mechanism, pairs, overshoot, samples, seed)

    def problem(
        self,
        goals: Sequence[FrameGoal] = (),
        regions: Sequence[InRegion] = (),
        constraints: Sequence[UserConstraint] = (),
        *,
        q_reference: ArrayLike | None = None,
        max_step: float | Array | None = None,
        max_link_rotation: float | None = None,
        tolerances: MechanismTolerances | None = None,
        margin: float = 0.0,
    ) -> MechanismProblem:
        """A question about this world, clear of all by `margin` metres; raises as `MechanismProblem`.

        Args:
            goals, regions, constraints: all of them hold.
            q_reference, max_step, max_link_rotation: as of `MechanismProblem`.
            tolerances: what counts as reached; None: the usual ones.
            margin: metres of clearance, where no tolerances say it.
        """
        return MechanismProblem(
            self.mechanism,
            tuple(goals),
            tuple(regions),
            tuple(constraints),
            obstacles=self.obstacles,
            cover=self.cover if len(self.cover) else None,
            apart=self.spheres.pairs if len(self.cover) else None,
            touching=self.touching,
            q_reference=None if q_reference is None else np.asarray(q_reference, dtype=float),
            max_step=max_step,
            max_link_rotation=max_link_rotation,
            tolerances=tolerances or MechanismTolerances(safety_margin=margin),
        )


def mechanism_in(
    scene: Scene | mujoco.MjModel | Mechanism | str | Path,
    *,
    qpos: ArrayLike | None = None,
    moving: Collection[str] | None = None,
    held: Sequence[Held] = (),
) -> Mechanism:
    """The mechanism in a scene, grasps among its closures; arguments and errors as of `MechanismWorld.of`."""
    mechanism = _mechanism(scene, qpos, moving, held)
    if not held:
        return mechanism
    grasps = (_grasp(mechanism, one) for one in held)
    return replace(mechanism, closures=(*mechanism.closures, *grasps))


def _mechanism(
    scene: Scene | mujoco.MjModel | Mechanism | str | Path,
    qpos: ArrayLike | None,
    moving: Collection[str] | None,
    held: Sequence[Held],
) -> Mechanism:
    if isinstance(scene, Mechanism):
        return scene
    where: str | Path | None = None
    if isinstance(scene, (str, Path)):
        where = scene
        scene = _loaded(scene)
    if isinstance(scene, Scene):
        if scene.mechanism is not None and qpos is None and moving is None:
            return scene.mechanism.mechanism
        qpos, where = scene.initial_qpos() if qpos is None else qpos, scene.path
        scene = scene.model
    if moving is None and held:
        driven = mechanism_of(scene, qpos=qpos, where=where)
        moving = [*dict.fromkeys([joint.name for joint in driven.joints] + _floating(scene, held))]
    elif moving is not None:
        moving = [*moving, *(name for name in _floating(scene, held) if name not in moving)]
    return mechanism_of(scene, qpos=qpos, moving=moving, where=where)


def _loaded(source: str | Path) -> Scene | mujoco.MjModel:
    """A task as its scene; a cell or a robot, by name or path, as the model that its file is."""
    name = str(source)
    if name.endswith(".toml") or (not is_path(name) and name in list_tasks()):
        return Scene.load(source)
    cell = not is_path(name) and name in list_assets("cells")
    return compile_spec(load_spec(source, kind="cells" if cell else "robots"), source)


def _floating(model: mujoco.MjModel, held: Sequence[Held]) -> list[str]:
    """Names of the joints by which bodies float that are held."""
    known = {str(model.body(body).name): body for body in range(1, model.nbody)}
    found = []
    for one in held:
        if one.body not in known:
            raise UnknownNameError("body", one.body, known, where="held")
        first = int(model.body_jntadr[known[one.body]])
        if first < 0 or int(model.jnt_type[first]) != 0:
            raise InputError(
                f"the body {one.body!r} does not float", where="held", remedy="a body with a free joint"
            )
        found.append(joint_label(model, first))
    return list(dict.fromkeys(found))


def _grasp(mechanism: Mechanism, held: Held) -> Closure:
    """The frame and the body as one."""
    body, frame = mechanism.frame(held.body), mechanism.frame(held.frame)
    T = held.T_frame_body
    if T is None:
        seen = measure_of(mechanism).frames((held.frame, held.body), mechanism.home)
        T = Pose.from_rotation(*seen[held.frame][::-1]).inverse() @ Pose.from_rotation(*seen[held.body][::-1])
    name = f"the grasp of {held.body} by {held.frame}"
    return Closure(name, "weld", (frame.link, body.link), (frame.T_link_frame @ T, body.T_link_frame))


def _world(
    mechanism: Mechanism, touching: tuple[tuple[str, str], ...], overshoot: float, samples: int, seed: int
) -> MechanismWorld:
    measure = measure_of(mechanism, touching)
    compiled = mechanism.compiled
    assert compiled is not None
    seen = set(np.unique(measure.pairs).tolist())
    intended = set(geoms_called(compiled.model, [name for pair in touching for name in pair], "touching"))
    links = compiled.link_of_body[compiled.model.geom_bodyid]
    fixed = {geom for geom in seen & intended if links[geom] == WORLD}
    cover = mechanism_cover(mechanism, overshoot=overshoot, geoms=seen, standing=fixed)
    obstacles = tuple(piece for piece in mechanism_pieces(mechanism, seen - fixed)[WORLD])
    by_spheres = (links[measure.pairs] != WORLD) | np.isin(measure.pairs, list(fixed))
    named = measure.pairs[by_spheres.all(axis=1)]
    spheres = SelfCollisionPairs(np.zeros((0, 2), dtype=np.int64))
    if len(named):
        drawn, free = _samples(mechanism, measure, samples, seed)
        spheres = apart_pairs(mechanism, cover, named, drawn, free)
        if free is not None and len(spheres.tolerated):
            cover = fitted_cover(mechanism, cover, spheres.tolerated, free)
            spheres = apart_pairs(mechanism, cover, named, drawn, free)
    return MechanismWorld(mechanism, cover, obstacles, spheres, touching, overshoot)


def _samples(
    mechanism: Mechanism, measure: MechanismMeasure, count: int, seed: int
) -> tuple[Array, Array | None]:
    """Configurations (c, size) at which ties hold, home first; those of them (k, size) that are known to be free."""
    rng, problem = np.random.default_rng(seed), MechanismProblem(mechanism, collisions=False)
    reach, tied = reach_of(mechanism), bool(mechanism.closures or mechanism.followers or mechanism.sums)
    home = polish_mechanism(problem, mechanism.home)
    found = [home.q] if home.worst < _CLOSED else []
    for _ in range(count):
        q = random_configuration(mechanism, rng, reach=reach)
        if tied:
            closed = polish_mechanism(problem, q)
            if closed.worst >= _CLOSED:
                continue
            q = closed.q
        found.append(q)
    if not found:
        found = [random_configuration(mechanism, rng, reach=reach) for _ in range(count)]
    free = home.worst < _CLOSED and measure.distance(home.q).distance > 0.0
    return np.array(found), np.array([home.q]) if free else None
