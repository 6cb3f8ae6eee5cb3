"""Scenes of the live benches: an arm, or two of a kind side by side, among shapes that stand or move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from workcell.model.loading.assets import find_asset
from workcell.model.scene import Scene

SIDES = ("left", "right")
"""Names of two arms."""


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A box, a capsule or a sphere.

    Attributes:
        name: of its body, and of the object where it moves.
        size: three half edges, a radius and half a length, or one radius, metres.
        position: (3,) metres, where it stands, or begins.
        quat_wxyz: how it is turned.
        moves: whether it is moved from outside.
    """

    name: str
    size: tuple[float, ...]
    position: tuple[float, float, float]
    quat_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    moves: bool = False

    @property
    def geom(self) -> str:
        """Its MJCF element."""
        kind = ("sphere", "capsule", "box")[len(self.size) - 1]
        return f'<geom name="{self.name}" type="{kind}" size="{_told(self.size)}" mass="1"/>'


def cell(robot: str, bases: Mapping[str, Sequence[float]], obstacles: Sequence[Obstacle] = ()) -> Scene:
    """A scene of arms of one model, by name, with the positions (3,) of their bases, among obstacles."""
    fixed = "".join(
        f'<body name="{one.name}" pos="{_told(one.position)}" quat="{_told(one.quat_wxyz)}">{one.geom}</body>'
        for one in obstacles
        if not one.moves
    )
    moving = [one for one in obstacles if one.moves]
    sites = "".join(f'<site name="{name}_mount" pos="{_told(at)}"/>' for name, at in bases.items())
    places = "".join(
        f'<site name="{one.name}_place" pos="{_told(one.position)}" quat="{_told(one.quat_wxyz)}"/>'
        for one in moving
    )
    model = find_asset("robots", robot).as_posix()
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "cell.xml").write_text(
            f'<mujoco model="cell"><worldbody>{sites}{places}{fixed}</worldbody></mujoco>', encoding="utf-8"
        )
        text = ['format = "workcell-task/1"', 'name = "live"', 'cell = "./cell.xml"']
        for arm in bases:
            text += ["[[robots]]", f'name = "{arm}"', f'model = "{model}"', f'mount = "{arm}_mount"']
        for one in moving:
            (folder / f"{one.name}.xml").write_text(
                f'<mujoco model="{one.name}"><worldbody><body name="{one.name}">{one.geom}</body>'
                "</worldbody></mujoco>",
                encoding="utf-8",
            )
            text += ["[[objects]]", f'name = "{one.name}"', f'model = "./{one.name}.xml"']
            text += [f'place = "{one.name}_place"']
        task = folder / "live.toml"
        task.write_text("\n".join(text), encoding="utf-8")
        return Scene.load(task)


def _told(numbers: Sequence[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
