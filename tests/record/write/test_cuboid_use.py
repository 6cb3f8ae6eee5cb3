"""The cuboids that links are in: told from geometry, written where they change, read as tables and pictures."""

from __future__ import annotations

import io
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from workcell.geometry.types import FreeSpace, SphereCover
from workcell.model.scene import Scene
from workcell.record.read.cuboids import LinkUse, cuboid_rows
from workcell.record.read.reader import read
from workcell.record.read.review import Review, review
from workcell.record.read.stage import Stage
from workcell.record.show.page_tables import cuboid_section
from workcell.record.show.planner_view import box_edges, cuboids_at
from workcell.record.show.plots import plot_metrics
from workcell.record.show.terminal import review_table
from workcell.record.write.recording import Recording

TIMES = np.linspace(0.0, 1.0, 41)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene.load("blocked")


@pytest.fixture(scope="module")
def cover(scene: Scene) -> SphereCover:
    """Three spheres a link, those of the base among them."""
    rng = np.random.default_rng(5)
    links = np.repeat(np.arange(scene.robot().robot.dof + 1), 3)
    return SphereCover(
        links, 0.06 * rng.normal(size=(len(links), 3)), rng.uniform(0.02, 0.05, len(links)), "outer"
    )


@pytest.fixture(scope="module")
def motion(scene: Scene) -> np.ndarray:
    """Raw positions (T, nq): all joints swing by up to half a turn."""
    arm, rng = scene.robot(), np.random.default_rng(6)
    qpos = np.tile(scene.initial_qpos(), (len(TIMES), 1))
    swing = np.sin(2 * np.pi * TIMES[:, None] * rng.uniform(0.3, 1.0, arm.robot.dof))
    qpos[:, arm.qpos_addresses] += rng.uniform(-1.5, 1.5, arm.robot.dof) * swing
    return qpos


@pytest.fixture(scope="module")
def space(scene: Scene, cover: SphereCover, motion: np.ndarray) -> FreeSpace:
    """Overlapping boxes around places where spheres come by, which leave some spheres out."""
    arm, rng = scene.robot(), np.random.default_rng(7)
    centres = cover.centres_world(arm.robot.link_transforms(motion[:, arm.qpos_addresses])).reshape(-1, 3)
    middle = centres[rng.integers(len(centres), size=12)]
    half = rng.uniform(0.15, 0.35, (12, 3))
    return FreeSpace(middle - half, middle + half)


@pytest.fixture(scope="module")
def file(
    tmp_path_factory: pytest.TempPathFactory,
    scene: Scene,
    cover: SphereCover,
    space: FreeSpace,
    motion: np.ndarray,
) -> Path:
    path = tmp_path_factory.mktemp("use") / "run.rrd"
    with Recording(path, task="swing", frame_rate=1000.0) as recording:
        recording.log_scene(scene)
        recording.log_free_space(space)
        recording.log_cover(scene.robot(), cover)
        for k in range(0, len(TIMES), 7):
            recording.log_states(TIMES[k : k + 7], motion[k : k + 7])
            recording.flush()
    return path


def holds(space: FreeSpace, cuboid: int, centre: np.ndarray, radius: float) -> bool:
    """Whether a sphere is wholly inside a cuboid, axis by axis."""
    return all(
        space.lower[cuboid, axis] <= centre[axis] - radius
        and centre[axis] + radius <= space.upper[cuboid, axis]
        for axis in range(3)
    )


def test_at_every_frame_the_links_are_where_the_recording_says(
    file: Path, scene: Scene, cover: SphereCover, space: FreeSpace, motion: np.ndarray
) -> None:
    """Against a plain loop over spheres and cuboids."""
    arm = scene.robot()
    uses = {use.link: use for use in Stage.of(read(file)).uses}
    assert list(uses) == list(arm.robot.link_names[1:])
    outside_ever = 0
    for k, time in enumerate(TIMES):
        centres = cover.centres_world(arm.robot.link_transforms(motion[k, arm.qpos_addresses]))
        for link, name in enumerate(arm.robot.link_names):
            if link == 0:
                continue
            use = uses[name]
            row = use.row_at(time)
            said = use.numbers[row]
            mine = np.flatnonzero(cover.link == link)
            inside = [
                [i for i in range(len(space)) if holds(space, i, centres[j], cover.radius[j])] for j in mine
            ]
            assert all(any(number in held for held in inside) for number in said)
            assert all(not held or set(held) & set(said) for held in inside)
            assert use.outside[row] == sum(not held for held in inside)
            outside_ever += use.outside[row]
    assert outside_ever > 0
    assert len({numbers for use in uses.values() for numbers in use.numbers}) > 5


def test_a_sphere_keeps_its_cuboid_until_it_leaves_it(
    tmp_path: Path, scene: Scene, motion: np.ndarray
) -> None:
    """The tool passes from one of two long boxes that overlap into the other, and back."""
    arm = scene.robot()
    tool = arm.robot.dof
    ball = SphereCover(np.array([tool]), np.zeros((1, 3)), np.array([0.01]))
    centres = ball.centres_world(arm.robot.link_transforms(motion[:, arm.qpos_addresses]))[:, 0]
    low, high = centres.min(axis=0) - 1.0, centres.max(axis=0) + 1.0
    axis = int(np.ptp(centres, axis=0).argmax())
    a, b = centres[:, axis].min(), centres[:, axis].max()
    cut_low, cut_high = a + 0.3 * (b - a), a + 0.7 * (b - a)
    upper, lower = high.copy(), low.copy()
    upper[axis], lower[axis] = cut_high, cut_low
    space = FreeSpace(np.stack([low, lower]), np.stack([upper, high]))
    with Recording(tmp_path / "run.rrd", task="swing", frame_rate=1000.0) as recording:
        recording.log_scene(scene)
        recording.log_free_space(space)
        recording.log_states(TIMES, motion)
        recording.log_cover(arm, ball)  # the start is told as soon as both are known
        recording.log_states(TIMES + 2.0, motion)
    (use,) = Stage.of(read(tmp_path / "run.rrd")).uses
    now = None
    for k, time in enumerate(TIMES + 2.0):
        inside = [i for i in (0, 1) if holds(space, i, centres[k], 0.01)]
        said = use.numbers[use.row_at(time)]
        assert len(said) == 1
        assert said[0] in inside
        if now is not None and now in inside:
            assert said[0] == now
        now = said[0]
    assert set(use.numbers) == {(0,), (1,)}


def test_metrics_count_the_cuboids_and_the_spheres_outside(file: Path, cover: SphereCover) -> None:
    found = review(file)
    uses = found.stage.uses
    in_use, outside = (found.series[f"{name}/ur10"] for name in ("cuboids_in_use", "spheres_in_no_cuboid"))
    for time, count, left in zip(in_use.times, in_use.values[:, 0], outside.values[:, 0], strict=True):
        rows = [(use, use.row_at(time)) for use in uses]
        assert count == len({number for use, row in rows for number in use.numbers[row]})
        assert left == sum(use.outside[row] for use, row in rows)
    assert outside.values.max() <= np.count_nonzero(cover.link > 0)


def test_shares_of_the_time_and_spans() -> None:
    use = LinkUse(
        "arm",
        "hand",
        (1.0, 0.0, 0.0),
        np.array([0.0, 1.0, 3.0]),
        ((2,), (2, 5), ()),
        np.array([0, 1, 2]),
    )
    (row,) = cuboid_rows([use], 4.0)
    assert row.shares == ((2, 0.75), (5, 0.5))
    assert row.outside == 0.75
    assert row.words == "2 (75%), 5 (50%)"
    assert use.spans(2, 4.0) == [(0.0, 3.0)]
    assert use.spans(5, 4.0) == [(1.0, 3.0)]
    assert use.spans(None, 4.0) == [(1.0, 4.0)]
    assert [use.row_at(time) for time in (-0.1, 0.0, 2.9, 3.0)] == [-1, 0, 1, 2]
    (still,) = cuboid_rows([use], 0.0)
    assert sum(share for _, share in still.shares) <= 2.0


def text_of(found: Review) -> str:
    console = Console(file=io.StringIO(), width=120)
    console.print(review_table(found))
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_the_review_tells_it_in_words_json_page_and_plot(file: Path) -> None:
    found = review(file)
    text = text_of(found)
    assert "Cuboids in use (of 12)" in text
    rows = json.loads(json.dumps(found.to_json()))["cuboids_in_use"]
    assert len(rows) == 6
    html = "".join(cuboid_section(found))
    for row, told in zip(rows, found.cuboids, strict=True):
        assert row["link"] in text
        assert told.words in html
        assert all(0.0 < entry["share"] <= 1.0 + 1e-9 for entry in row["cuboids"])
    titles = [axes.get_title(loc="left") for axes in plot_metrics(found).axes]
    assert any(title.startswith("free-space cuboids") for title in titles)
    assert not any("cuboids in use" in title for title in titles)


def test_the_picture_knows_who_is_where_at_a_time(file: Path) -> None:
    stage = Stage.of(read(file))
    at = cuboids_at(stage, 0.5)
    for use in stage.uses:
        row = use.numbers[use.row_at(0.5)]
        assert {number for number, links in at.items() if use.link in links} == set(row)
    edges = box_edges(np.zeros(3), np.array([1.0, 2.0, 3.0]))
    assert len(edges) == 12
    assert sum(np.linalg.norm(edge[-1] - edge[0]) for edge in edges) == pytest.approx(4 * 6.0)


def test_another_free_space_adds_and_known_cuboids_keep_their_numbers(tmp_path: Path) -> None:
    first = FreeSpace([[0, 0, 0], [1, 0, 0]], [[1, 1, 1], [2, 1, 1]])
    second = FreeSpace([[5, 0, 0], [1, 0, 0]], [[6, 1, 1], [2, 1, 1]])
    with Recording(tmp_path / "run.rrd", task="boxes") as recording:
        recording.log_free_space(first)
        recording.log_free_space(second)
    boxes = read(tmp_path / "run.rrd").below("world/free_space")
    corners = {
        path.rpartition("/")[2]: np.asarray(entity.static["Boxes3D:centers"])[0, 0]
        for path, entity in boxes.items()
    }
    assert corners == {"0": 0.5, "1": 1.5, "2": 5.5}


def test_worlds_that_are_planned_in_are_recorded_once(
    tmp_path: Path, scene: Scene, cover: SphereCover, space: FreeSpace
) -> None:
    """The cover of a robot without one, and the cuboids that are new."""
    near = SimpleNamespace(scene=scene, robot=scene.robot(), cover=cover, free_space=space)
    larger = FreeSpace([*space.lower, [3, 3, 3]], [*space.upper, [4, 4, 4]])
    other = SphereCover(cover.link[:2], cover.centre[:2], cover.radius[:2])
    far = SimpleNamespace(scene=scene, robot=scene.robot(), cover=other, free_space=larger)
    with Recording(tmp_path / "run.rrd", task="work") as recording:
        recording.log_scene(scene)
        recording.log_world(near)
        recording.log_world(near)
        recording.log_world(far)
    contents = read(tmp_path / "run.rrd")
    assert len(contents.below("world/free_space")) == len(space) + 1
    uses = Stage.of(contents).uses
    assert [use.link for use in uses] == list(scene.robot().robot.link_names[1:])
    assert all(set(use.times) == {0.0} for use in uses)
