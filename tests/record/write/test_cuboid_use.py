"""The cuboids that decided: as the solver assigned them, followed along the ways, measured where the robot is."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from workcell.geometry.free_space.polytopes import solid_of
from workcell.geometry.types import FreePolytope, FreeSpace, SphereCover
from workcell.ik.observing import report
from workcell.ik.problem import IKProblem
from workcell.ik.result import IKResult, Status
from workcell.model.scene import Scene
from workcell.pose import Array
from workcell.record.read.compare import compare
from workcell.record.read.cuboids import LinkUse, cuboid_rows
from workcell.record.read.reader import read
from workcell.record.read.review import Review, review
from workcell.record.read.stage import Stage
from workcell.record.show.outline import box_edges
from workcell.record.show.page_tables import cuboid_section
from workcell.record.show.planner_view import cuboids_at
from workcell.record.show.plots import plot_metrics
from workcell.record.show.terminal import review_table
from workcell.record.write.recording import Recording

WAYPOINTS, FRAMES_A_STEP = 6, 9
TIMES = np.linspace(0.0, 1.0, (WAYPOINTS - 1) * FRAMES_A_STEP + 1)


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
def way(scene: Scene) -> Array:
    """Waypoints (k, n), from the start on, by steps that differ from joint to joint."""
    robot = scene.robot()
    steps = np.random.default_rng(6).uniform(0.05, 0.15, (WAYPOINTS - 1, robot.robot.dof))
    return robot.start + np.concatenate([np.zeros((1, robot.robot.dof)), np.cumsum(steps, axis=0)])


@pytest.fixture(scope="module")
def motion(scene: Scene, way: Array) -> Array:
    """Raw positions (T, nq), straight from waypoint to waypoint."""
    qpos = np.tile(scene.initial_qpos(), (len(TIMES), 1))
    share = TIMES * (WAYPOINTS - 1)
    for joint, address in enumerate(scene.robot().qpos_addresses):
        qpos[:, address] = np.interp(share, np.arange(WAYPOINTS), way[:, joint])
    return qpos


@pytest.fixture(scope="module")
def space(scene: Scene, cover: SphereCover, way: Array) -> FreeSpace:
    """Boxes around places where spheres come by, and a polytope around all."""
    rng = np.random.default_rng(7)
    centres = cover.centres_world(scene.robot().robot.link_transforms(way)).reshape(-1, 3)
    middle, half = centres[rng.integers(len(centres), size=12)], rng.uniform(0.25, 0.6, (12, 3))
    faces = rng.normal(size=(14, 3))
    faces /= np.linalg.norm(faces, axis=1, keepdims=True)
    around = FreePolytope(faces, np.max(centres @ faces.T, axis=0) + 0.02, 0.0)
    return FreeSpace(middle - half, middle + half, polytopes=(around,))


@pytest.fixture(scope="module")
def homes(cover: SphereCover, space: FreeSpace) -> np.ndarray:
    """For each waypoint and sphere (k, m) some cuboid or the polytope, wherever the sphere is; -1 on the base."""
    found = np.random.default_rng(8).integers(len(space) + 1, size=(WAYPOINTS, len(cover)))
    found[:, cover.link == 0] = -1
    return found


def answered(
    scene: Scene,
    way: Array,
    cover: SphereCover | None,
    space: FreeSpace | None,
    homes: Sequence[Array] | None,
    solver: str = "ikspark",
) -> None:
    """A goal configuration and steps from one waypoint (k, n) to the next, as if a solver had answered them."""
    robot = scene.robot().robot
    for k, q in enumerate(way):
        step = {} if k == 0 else {"q_reference": way[k - 1], "max_step": 0.2}
        problem = IKProblem(robot, robot.fk(q), cover=cover, free_space=space, **step)  # type: ignore[arg-type]
        cuboids = None if homes is None else homes[k]
        report(problem, IKResult(Status.SOLVED, solver, q=q, cuboids=cuboids, free_space=space))


def record(
    path: Path, scene: Scene, motion: Array, times: Array = TIMES, planner: str = "ikspark"
) -> Recording:
    recording = Recording(path, task="swing", planner=planner, frame_rate=1000.0)
    recording.log_scene(scene)
    return recording


def executed(recording: Recording, motion: Array, times: Array = TIMES) -> None:
    for k in range(0, len(times), 7):
        recording.log_states(times[k : k + 7], motion[k : k + 7])
        recording.flush()


@pytest.fixture(scope="module")
def file(
    tmp_path_factory: pytest.TempPathFactory,
    scene: Scene,
    cover: SphereCover,
    space: FreeSpace,
    way: Array,
    homes: np.ndarray,
    motion: Array,
) -> Path:
    path = tmp_path_factory.mktemp("use") / "run.rrd"
    with record(path, scene, motion) as recording:
        recording.log_free_space(space)
        recording.log_cover(scene.robot(), cover)
        with recording.queries("there"):
            answered(scene, way, cover, space, homes)
        executed(recording, motion)
    return path


def nearest(k: int) -> int:
    """The waypoint of frame k; none is half-way between two."""
    return round(k / FRAMES_A_STEP)


def sticks_out(space: FreeSpace, number: int, centre: Array, radius: float) -> float:
    """Metres by which a sphere is outside, face by face."""
    if number < len(space):
        low, high = space.lower[number], space.upper[number]
        return max(max(low[i] - centre[i], centre[i] - high[i]) + radius for i in range(3))
    polytope = space.polytopes[number - len(space)]
    return max(float(a @ centre - b) + radius for a, b in zip(polytope.A, polytope.b, strict=True))


def test_at_every_frame_the_links_are_where_the_solver_had_them(
    file: Path, scene: Scene, cover: SphereCover, space: FreeSpace, homes: np.ndarray, motion: Array
) -> None:
    """Whatever geometry says; and a plain loop counts the spheres that are not inside."""
    arm = scene.robot()
    uses = {use.link: use for use in Stage.of(read(file)).uses}
    assert list(uses) == list(arm.robot.link_names[1:])
    outside, inside = 0, 0
    for k, time in enumerate(TIMES):
        centres = cover.centres_world(arm.robot.link_transforms(motion[k, arm.qpos_addresses]))
        for link, name in enumerate(arm.robot.link_names[1:], start=1):
            row = uses[name].row_at(time)
            mine = np.flatnonzero(cover.link == link)
            assigned = homes[nearest(k)][mine]
            assert uses[name].numbers[row] == tuple(sorted(set(assigned.tolist())))
            deep = [
                sticks_out(space, n, centres[j], cover.radius[j]) for j, n in zip(mine, assigned, strict=True)
            ]
            assert uses[name].outside[row] == sum(depth > 1e-6 for depth in deep)
            outside += sum(depth > 1e-6 for depth in deep)
            inside += sum(depth <= 1e-6 for depth in deep)
    assert outside > 100 and inside > 100


def test_metrics_count_the_cuboids_and_measure_what_sticks_out(
    file: Path, scene: Scene, cover: SphereCover, space: FreeSpace, homes: np.ndarray, motion: Array
) -> None:
    found, arm = review(file), scene.robot()
    names = ("cuboids_in_use", "spheres_outside", "outside_cuboids")
    used, out, by = (found.series[f"{name}/ur10"] for name in names)
    assert used.times[-len(TIMES) :] == pytest.approx(TIMES)
    for k in range(1, len(TIMES)):
        now, row = homes[nearest(k)], len(used.times) - len(TIMES) + k
        centres = cover.centres_world(arm.robot.link_transforms(motion[k, arm.qpos_addresses]))
        deep = [
            sticks_out(space, now[j], centres[j], cover.radius[j]) for j in np.flatnonzero(cover.link > 0)
        ]
        assert used.values[row, 0] == len({*now.tolist()} - {-1})
        assert out.values[row, 0] == sum(depth > 1e-6 for depth in deep)
        assert by.values[row, 0] == pytest.approx(max(0.0, *deep), abs=1e-9)


def test_a_sphere_in_two_cuboids_is_shown_in_that_which_was_assigned(
    tmp_path: Path, scene: Scene, motion: Array, way: Array
) -> None:
    """The second of two that hold it, and the first of which geometry would take."""
    tool = scene.robot().robot.dof
    ball = SphereCover(np.array([tool]), np.zeros((1, 3)), np.array([0.01]))
    space = FreeSpace([[-5.0] * 3, [-4.0] * 3], [[5.0] * 3, [4.0] * 3])
    with record(tmp_path / "run.rrd", scene, motion) as recording:
        with recording.queries("there"):
            answered(scene, way, ball, space, [np.array([1])] * WAYPOINTS)
        executed(recording, motion)
    (use,) = Stage.of(read(tmp_path / "run.rrd")).uses
    (number,) = {number for numbers in use.numbers for number in numbers}
    box = read(tmp_path / "run.rrd").entities[f"world/free_space/{number}"].static
    assert np.asarray(box["Boxes3D:half_sizes"]) == pytest.approx(np.full((1, 3), 4.0))
    assert use.numbers == ((number,),) and use.outside.tolist() == [0]


def test_off_the_ways_and_on_others_ways_no_cuboid_decided(
    tmp_path: Path,
    scene: Scene,
    cover: SphereCover,
    space: FreeSpace,
    way: Array,
    homes: np.ndarray,
    motion: Array,
) -> None:
    """The first half is planned among cuboids, the second locally; then a joint motion leads elsewhere."""
    half = WAYPOINTS // 2
    aside = np.array(motion[::-1])
    aside[1:, scene.robot().qpos_addresses[0]] += 0.3
    with record(tmp_path / "run.rrd", scene, motion) as recording:
        with recording.queries("there"):
            answered(scene, way[:half], cover, space, homes)
        with recording.queries("on"):
            answered(scene, way[half - 1 :], cover, space, None, solver="local")
        executed(recording, motion)
        executed(recording, aside[1:], TIMES[1:] + 1.0)
    found = review(tmp_path / "run.rrd")
    for use in found.stage.uses:
        for k, time in enumerate(TIMES):
            assert bool(use.numbers[use.row_at(time)]) == (k <= (half - 1) * FRAMES_A_STEP), k
        assert use.numbers[-1] == () and use.times[-1] < 1.0
    assert [(row.what, row.time_share) for row in found.ways] == [
        ("there", pytest.approx(0.2, abs=0.02)),
        ("on", pytest.approx(0.3, abs=0.02)),
    ]
    assert found.no_way_share == pytest.approx(0.5, abs=0.02)
    assert "% of the time on no way that was asked for" in found.ways_said
    (places,) = found.places
    assert list(zip(places.ways, places.by, strict=True)) == [
        ("there", "ikspark"),
        ("on", "local"),
        (None, ""),
    ]
    assert all(row.undecided > 0.5 and "%" in row.cells[1] for row in found.cuboids)
    out = found.series["spheres_outside/ur10"]
    assert np.isnan(out.values[out.times > 1.0]).all() and not np.isnan(out.values[0]).any()


def text_of(found: Review) -> str:
    console = Console(file=io.StringIO(), width=160)
    console.print(review_table(found))
    return console.file.getvalue()  # type: ignore[attr-defined]


@pytest.mark.parametrize("planner", ["auto", "cidgik"])
def test_where_no_cuboid_decided_it_is_said(
    tmp_path: Path,
    scene: Scene,
    cover: SphereCover,
    space: FreeSpace,
    way: Array,
    motion: Array,
    planner: str,
) -> None:
    """However many cuboids the links are in."""
    with record(tmp_path / "run.rrd", scene, motion, planner=planner) as recording:
        recording.log_free_space(space)
        recording.log_cover(scene.robot(), cover)
        with recording.queries("there"):
            answered(scene, way, cover, space, None, solver=planner)
        executed(recording, motion)
    found = review(tmp_path / "run.rrd")
    assert found.cuboids == () and found.stage.uses == ()
    words = f"no cuboid decided anything; planner: {planner}"
    assert words in text_of(found) and words in "".join(cuboid_section(found))
    assert found.to_json()["cuboids_in_use"] == [] and found.to_json()["cuboids_said"] == words
    assert not any(name.startswith("cuboids_in_use") for name in found.series)


def test_the_review_tells_it_in_words_json_page_and_plot(file: Path) -> None:
    found = review(file)
    text = text_of(found)
    words = "cuboids that the planner, ikspark, had the links in"
    assert "Cuboids in use (of 13)" in text and words in text
    told = json.loads(json.dumps(found.to_json()))
    assert told["cuboids_said"] == words and len(told["cuboids_in_use"]) == 6
    html = "".join(cuboid_section(found))
    for row, line in zip(told["cuboids_in_use"], found.cuboids, strict=True):
        assert row["link"] in text
        assert all(cell in html for cell in line.cells)
        assert all(0.0 < entry["share"] <= 1.0 + 1e-9 for entry in row["cuboids"])
        assert row["undecided_share"] == 0.0 and row["outside_share"] > 0.0
    titles = [axes.get_title(loc="left") for axes in plot_metrics(found).axes]
    assert any(title.startswith(words) for title in titles)
    assert not any(title.startswith(("cuboids in use", "spheres outside")) for title in titles)


def test_the_picture_knows_who_is_where_at_a_time(file: Path) -> None:
    stage = Stage.of(read(file))
    at = cuboids_at(stage, 0.5)
    for use in stage.uses:
        row = use.numbers[use.row_at(0.5)]
        assert {number for number, links in at.items() if use.link in links} == set(row)
    edges = box_edges(np.zeros(3), np.array([1.0, 2.0, 3.0]))
    assert len(edges) == 12
    assert sum(np.linalg.norm(edge[-1] - edge[0]) for edge in edges) == pytest.approx(4 * 6.0)


def test_a_polytope_has_a_number_and_its_edges_are_drawn_while_it_is_used(
    file: Path, scene: Scene, space: FreeSpace, cover: SphereCover, homes: np.ndarray
) -> None:
    contents = read(file)
    assert f"world/free_space/{len(space)}" in contents.entities
    solid = solid_of(space.polytopes[0])
    edges = {tuple(sorted(edge)) for edge in solid.edges.tolist()}
    name = scene.robot().robot.link_names[1]
    times, strips = contents.entities[f"world/cuboids_in_use/ur10/{name}"].over_time("LineStrips3D:strips")
    used = [len(space) in homes[k][cover.link == 1] for k in range(WAYPOINTS)]
    assert {len(strip) for strip in strips} == {0, 1} and len({*used}) == 2
    for time, strip in zip(times, strips, strict=True):
        assert len(strip) == used[nearest(round(time * (len(TIMES) - 1)))]
        for line in strip:
            apart = np.linalg.norm(np.asarray(line)[:, None] - solid.vertices, axis=2)
            at = apart.argmin(axis=1)
            assert apart.min(axis=1).max() < 1e-5
            assert {tuple(sorted(pair)) for pair in zip(at.tolist(), at[1:].tolist(), strict=False)} == edges


def test_shares_of_the_time_and_spans() -> None:
    use = LinkUse(
        "arm",
        "hand",
        (1.0, 0.0, 0.0),
        np.array([0.0, 1.0, 3.0]),
        ((2,), (2, 5), ()),
        np.array([0, 1, 0]),
    )
    (row,) = cuboid_rows([use], 4.0)
    assert row.shares == ((2, 0.75), (5, 0.5))
    assert (row.undecided, row.outside) == (0.25, 0.5)
    assert row.cells == ("2 (75%), 5 (50%)", "25%", "50%")
    assert use.spans(2, 4.0) == [(0.0, 3.0)]
    assert use.spans(5, 4.0) == [(1.0, 3.0)]
    assert use.spans(None, 4.0) == [(1.0, 3.0)]
    assert [use.row_at(time) for time in (-0.1, 0.0, 2.9, 3.0)] == [-1, 0, 1, 2]
    (still,) = cuboid_rows([use], 0.0)
    assert sum(share for _, share in still.shares) <= 2.0
    (late,) = cuboid_rows([replace(use, times=use.times + 1.0)], 5.0)
    assert dict(late.shares) == pytest.approx({2: 0.6, 5: 0.4}) and late.undecided == pytest.approx(0.4)


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
    assert len(contents.below("world/free_space")) == len(space) + 2
    spheres = contents.below("world/robots/ur10/spheres")
    assert len(spheres) == scene.robot().robot.dof + 1


def test_an_older_layout_s_cuboids_are_told_by_geometry_alone(
    file: Path, tmp_path: Path, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its links had their numbers as labels of boxes."""
    monkeypatch.setattr("workcell.record.write.scene_log.FORMAT", 2)
    with Recording(tmp_path / "old.rrd", task="old") as recording:
        recording.log_scene(scene)
        at = (np.array([0.0, 1.0]), np.array([0, 500]))
        boxes = [(np.zeros((1, 3)), np.ones((1, 3)), [label]) for label in ("3", "7")]
        recording._writer.send_boxes("world/cuboids_in_use/ur10/hand", at, boxes)
        recording._writer.send_numbers("world/cuboids_in_use/ur10/hand", at, spheres_outside=[0, 2])
    found = review(tmp_path / "old.rrd")
    (use,) = found.stage.uses
    assert use.numbers == ((3,), (7,)) and use.outside.tolist() == [0, 2]
    assert found.by_geometry and not review(file).by_geometry
    apart = compare(found, review(file)).cuboids
    assert [row[0] for row in apart] == ["cuboids in use"], "what links were in is not what decided"
    assert compare(review(file), review(file)).cuboids == ()
    assert "cuboids that links were in, by geometry alone" in text_of(found)
    assert not [words for words in found.missing if "layout" in words]
