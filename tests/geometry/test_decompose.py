import json

import matplotlib.image
import numpy as np
import pytest

from tests.geometry.shapes import points_inside
from workcell.errors import OutputError
from workcell.geometry.decompose import decompose
from workcell.model.scene import Scene
from workcell.record.show.decomposition import decomposition_figure, draw_decomposition

CELL = """<mujoco model="cell"><worldbody>
  <geom name="floor" type="plane" size="1 1 .1" pos="0 0 -1"/>
  <body name="table" pos=".6 0 -.2"><geom name="top" type="box" size=".15 .2 .02"/></body>
  <body name="post" pos=".3 .4 0"><geom name="post" type="cylinder" size=".04 .15"/></body>
  <site name="robot_mount"/>
</worldbody></mujoco>"""


@pytest.fixture(scope="module")
def decomposition(tmp_path_factory):
    path = tmp_path_factory.mktemp("cells") / "cell.xml"
    path.write_text(CELL)
    steps = []
    result = decompose(Scene.load(path, robot="ur10"), overshoot=0.04, progress=lambda: steps.append(1))
    assert len(steps) == 6
    return result


def test_everything_is_proved_and_measured(decomposition):
    metrics = decomposition.metrics
    assert metrics["robot_cover_proved"] is True and metrics["obstacle_cover_proved"] is True
    assert metrics["robot_overshoot_max_m"] <= 0.04 + 1e-9
    assert metrics["covered_fraction"] > 0.5
    assert metrics["cuboids"] == len(decomposition.free_space) > 0
    assert (
        decomposition.free_space.covered_fraction == metrics["covered_fraction"] >= metrics["cuboid_fraction"]
    )
    assert metrics["polytopes"] == len(decomposition.free_space.polytopes)


def test_json_is_in_the_world_and_covers_robot_and_obstacles(decomposition):
    document = json.loads(json.dumps(decomposition.to_json()))
    assert set(document) == {"spheres", "q", "cuboids", "polytopes", "metrics"}
    assert set(document["spheres"][0]) == {"of", "kind", "body", "centre", "radius"}
    rng = np.random.default_rng(0)
    pieces = {"robot": decomposition.robot_pieces, "obstacle": decomposition.obstacles}
    for of, group in pieces.items():
        rows = [row for row in document["spheres"] if row["of"] == of]
        assert {row["body"] for row in rows} <= {piece.body for piece in group}
        centre = np.array([row["centre"] for row in rows])
        radius = np.array([row["radius"] for row in rows])
        for piece in group:
            if piece.kind != "halfspace":
                points = points_inside(rng, piece, 500)
                gaps = np.linalg.norm(points[:, None] - centre, axis=2) - radius
                assert gaps.min(axis=1).max() <= 0
    for cuboid in document["cuboids"]:
        assert np.all(np.array(cuboid["lower"]) < cuboid["upper"])
        assert cuboid["lower"][2] >= -1


def test_picture_is_written(decomposition, tmp_path):
    """As a PNG of the figure (what is in it is tested beside the other pictures), or not at all."""
    draw_decomposition(decomposition, tmp_path / "cell.png")
    figure = decomposition_figure(decomposition)
    figure.canvas.draw()
    written = matplotlib.image.imread(tmp_path / "cell.png")
    assert np.array_equal(np.round(255 * written), np.asarray(figure.canvas.buffer_rgba()))
    assert f"{decomposition.metrics['obstacle_spheres']} on obstacles" in figure.get_suptitle()
    with pytest.raises(OutputError, match="can't be written"):
        draw_decomposition(decomposition, tmp_path / "missing" / "cell.png")


def test_a_cell_without_a_robot_is_shown(tmp_path):
    (tmp_path / "cell.xml").write_text(
        '<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>'
        '<geom name="post" type="box" size=".1 .1 .4" pos="1 0 .4"/>'
        '<body name="ball" pos="0 1 .2"><geom type="sphere" size=".2"/></body></worldbody></mujoco>'
    )
    scene = Scene.load(tmp_path / "cell.xml")
    steps = []
    alone = decompose(scene, overshoot=0.03, progress=lambda: steps.append(1))
    assert len(steps) == 6
    assert (alone.robot, alone.robot_pieces, len(alone.robot_cover), len(alone.free_space)) == (
        None,
        (),
        0,
        0,
    )
    assert alone.metrics["half_spaces_not_covered"] == ["floor"]
    assert alone.metrics["obstacle_pieces"] == 3 and alone.metrics["obstacle_cover_proved"]
    document = alone.to_json()
    assert document["q"] == [] and {sphere["of"] for sphere in document["spheres"]} == {"obstacle"}
    low = (alone.obstacle_cover.centre - alone.obstacle_cover.radius[:, None]).min(axis=0)
    assert low == pytest.approx([-0.2, -0.1, 0.0], abs=0.031)
