"""The five tasks of RelaxedIK's section 5.3 as tool poses at 50 Hz, scaled to an arm.

The paper's traces were animated by hand and are not published; these are made of the same words. At rest a hand points
away from the base, level: its frame has x forwards, y to the left and z up. Paths lie around the setup's centre; a
length of 1 is the setup's size, close to what the arm can reach around there. Nothing eases in or out but
where key poses do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from workcell.pose import Array, Pose, axis_angle_to_matrix, matrix_to_quat

PERIOD = 0.02
"""Seconds a frame, of the paper."""
_SECONDS = 8.8
"""Of a path at pace 1: the paper's 1,535,500 frames are 439 of each of its runs."""
_X, _Y, _Z = np.eye(3)


@dataclass(frozen=True, slots=True)
class Setup:
    """How the tasks are laid out for an arm.

    Attributes:
        robot: its model.
        centre: (3,) of the paths, metres from the base.
        turning: (3,) where the hand turns without moving.
        size: metres, the circle's radius.
        pace: by which the paths take longer, where the joints are slow.
        apart: metres between the bases of two arms, side by side.
        side: metres by which the arm's shoulder is to the left of its base.
        in_plane: the hand can't leave the vertical plane through the base's axis that its tool is in, as with five
            joints: goals are turned about the vertical until they are in it.
    """

    robot: str
    centre: tuple[float, float, float]
    turning: tuple[float, float, float]
    size: float
    pace: float = 1.0
    apart: float = 0.7
    side: float = 0.0
    in_plane: bool = False

    def base(self, arm: int, arms: int) -> Array:
        """(3,) metres, where the base of an arm of one, or of two, stands: the first of two on the left."""
        return np.zeros(3) if arms == 1 else np.array([0.0, (0.5 - arm) * self.apart, 0.0])


@dataclass(frozen=True, slots=True)
class Trace:
    """Goals of every frame.

    Attributes:
        task: its name.
        positions: (arms, k, 3) metres.
        quats: (arms, k, 4) wxyz.
    """

    task: str
    positions: Array
    quats: Array

    @property
    def arms(self) -> int:
        """How many tools have goals."""
        return len(self.positions)

    def __len__(self) -> int:
        return int(self.positions.shape[1])

    def goals(self, frame: int) -> list[Pose]:
        """Each tool's pose in a frame."""
        return [Pose(self.positions[arm, frame], self.quats[arm, frame]) for arm in range(self.arms)]

    def rows(self, arm: int) -> Array:
        """(k, 7) positions and quaternions of one tool."""
        return np.concatenate([self.positions[arm], self.quats[arm]], axis=1)


@dataclass(frozen=True, slots=True)
class _Path:
    """Of one hand: (k, 3) in units of the setup's size around its centre, and rotations (k, 3, 3) from rest."""

    places: Array
    turns: Array


def trace(task: str, setup: Setup, rest: Array) -> Trace:
    """A task's trace for a setup.

    Args:
        task: one of `TASKS`.
        setup: of the arm, or of each of two.
        rest: (3, 3) the tool's rotation where the hand is at rest.
    """
    paths = TASKS[task](setup)
    positions, quats = [], []
    for arm, path in enumerate(paths):
        base = setup.base(arm, len(paths))
        # two hands work in the middle between the bases
        middle = np.array(setup.turning if task == "rotations" else setup.centre)
        middle[1] = setup.side if len(paths) > 1 else middle[1]
        places = middle + setup.size * path.places
        turns = path.turns
        if setup.in_plane:
            away = places - base
            turns = _about(_Z, np.arctan2(away[:, 1], away[:, 0])) @ turns
        positions.append(places)
        quats.append(_quats(turns @ rest))
    return Trace(task, np.array(positions), np.array(quats))


def _frames(setup: Setup, share: float = 1.0) -> int:
    return round(share * setup.pace * _SECONDS / PERIOD)


def _circle(setup: Setup) -> list[_Path]:
    """Once around, in the plane across the arm, beginning at the bottom."""
    angle = np.linspace(0.0, 2.0 * np.pi, _frames(setup) + 1)[:, None]
    return [_held(np.sin(angle) * _Y - np.cos(angle) * _Z)]


def _square(setup: Setup) -> list[_Path]:
    """Once around at one speed, corners included; they are as far out as the circle."""
    half = np.sqrt(0.5)
    corners = half * np.array([[0, -1], [1, -1], [1, 1], [-1, 1], [-1, -1], [0, -1]], dtype=float)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], _frames(setup) + 1)
    across, up = (np.interp(at, along, corners[:, k]) for k in (0, 1))
    return [_held(across[:, None] * _Y + up[:, None] * _Z)]


def _rotations(setup: Setup) -> list[_Path]:
    """A quarter turn one way, 180 degrees to the other and back, about yaw, pitch and roll, without translation."""
    swing = 0.5 * np.pi * np.sin(np.linspace(0.0, 2.0 * np.pi, _frames(setup, 0.7) + 1))
    axes = (_Y, _X) if setup.in_plane else (_Z, _Y, _X)
    turns = np.concatenate([_about(axis, _smooth(swing[:, None])[:, 0]) for axis in axes])
    return [_Path(np.zeros((len(turns), 3)), turns)]


def _feeding(setup: Setup) -> list[_Path]:
    """A spoon dips into two bowls and comes level to the mouth of who sits in front, twice."""
    low, mouth = -0.65, np.array([0.15, 0.1, 0.45])
    keys: list[tuple[float, Array, Array]] = [(0.0, np.array([-0.3, 0.0, 0.0]), np.zeros(3))]
    for start, side in ((0.1, 0.55), (0.55, -0.55)):
        bowl = np.array([-0.1, side, low])
        away = 0.35 * np.sign(side)
        keys += [
            (start, bowl + 0.3 * _Z, np.array([0.0, 0.7, away])),
            (start + 0.07, bowl, np.array([0.0, 0.9, away])),
            (start + 0.12, bowl + 0.06 * _X, np.array([0.0, 0.3, away])),
            (start + 0.18, bowl + 0.35 * _Z, np.array([0.0, 0.0, 0.5 * away])),
            (start + 0.31, mouth - [0.3, 0.0, 0.0], np.zeros(3)),
            (start + 0.36, mouth, np.zeros(3)),
            (start + 0.40, mouth - [0.25, 0.0, 0.0], np.array([0.0, -0.15, 0.0])),
        ]
    return [_keyed(keys, _frames(setup, 2.0), setup)]


def _cooking(setup: Setup) -> list[_Path]:
    """Two hands take a pot by its handles, lift it off the stove, and set it down on the counter beside it."""
    stove, counter = np.array([0.0, 0.28, -0.45]), np.array([0.05, -0.28, -0.35])
    over, paths = 0.35 * _Z, []
    for side in (1.0, -1.0):
        handle = 0.3 * side * _Y
        aside, bent = handle + 0.2 * side * _Y, np.array([0.0, 0.35, -0.2 * side])
        at = [
            (0.0, 0.45 * side * _Y, np.zeros(3)),
            (0.14, stove + aside, bent),
            (0.24, stove + handle, bent),
            (0.29, stove + handle, bent),
            (0.43, stove + handle + over, bent),
            (0.62, counter + handle + over, bent),
            (0.76, counter + handle, bent),
            (0.81, counter + handle, bent),
            (0.90, counter + aside, bent),
            (1.0, 0.45 * side * _Y, np.zeros(3)),
        ]
        paths.append(_keyed(at, _frames(setup, 1.2), setup))
    return paths


TASKS: Mapping[str, Callable[[Setup], list[_Path]]] = MappingProxyType(
    {
        "circle": _circle,
        "square": _square,
        "rotations": _rotations,
        "spoon feeding": _feeding,
        "cooking": _cooking,
    }
)
"""By name; each makes the paths of its hands."""


def _held(places: Array) -> _Path:
    return _Path(places, np.tile(np.eye(3), (len(places), 1, 1)))


def _keyed(keys: Sequence[tuple[float, Array, Array]], frames: int, setup: Setup) -> _Path:
    """Through key poses (share of the time, place, rotation vector), at rest in the first and in the last.

    Monotone cubics: nothing swings beyond its keys, and where two are equal the hand stands still.
    """
    from scipy.interpolate import PchipInterpolator

    times = np.array([key[0] for key in keys])
    values = np.array([np.concatenate([place, turn]) for _, place, turn in keys])
    if setup.in_plane:
        values[:, 5] = 0.0
    way = _smooth(PchipInterpolator(times, values)(np.linspace(times[0], times[-1], frames + 1)))
    angle = np.linalg.norm(way[:, 3:], axis=1)
    axis = np.where(angle[:, None] > 1e-12, way[:, 3:] / np.maximum(angle, 1e-12)[:, None], _X)
    return _Path(way[:, :3], _about(axis, angle))


def _smooth(way: Array) -> Array:
    """(k, c) averaged over 0.2 s twice: it begins and ends at rest, and takes 0.4 s longer."""
    width = 10
    for _ in range(2):
        padded = np.concatenate([np.repeat(way[:1], width, axis=0), way, np.repeat(way[-1:], width, axis=0)])
        sums = np.cumsum(np.concatenate([np.zeros((1, way.shape[1])), padded]), axis=0)
        way = (sums[width:] - sums[:-width]) / width
    return way


def _about(axis: Array, angle: Array) -> Array:
    """(k, 3, 3) rotations about one axis, or about k, by k angles."""
    return axis_angle_to_matrix(np.broadcast_to(axis, (len(angle), 3)), angle)


def _quats(rotations: Array) -> Array:
    """(k, 4) without jumps of sign."""
    quats = np.array([matrix_to_quat(R) for R in rotations])
    for k in range(1, len(quats)):
        if quats[k] @ quats[k - 1] < 0.0:
            quats[k] = -quats[k]
    return quats
