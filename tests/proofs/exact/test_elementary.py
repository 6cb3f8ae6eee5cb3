"""`reach` and `last_link` against lengths that are known in closed form."""

from __future__ import annotations

import json
import os

import pytest

from tests.proofs.exact.documents import DOWN, about_z, certificate, joint, planar, problem, problem_set
from workcell.proofs.exact.problems import read_problems
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.verdicts import check

BALL = {"spheres": [{"centre": [0.6, 0.0, 0.0], "radius": 0.1}]}


def reach(margin, slides, third=0.0):
    statement = (
        f"the target is {1e3 * margin:.1f} mm out of reach by the triangle inequality along the chain, "
        f"covering 0.1 mm, 0.001 rad and {1e3 * third:g} mm of penetration"
    )
    return certificate(
        "reach", "kinematics", statement, margin, tolerances=[1e-4, 1e-3, third], slides=slides
    )


def last_link(margin, pair, allowed=0.0, name="sphere 0", link="link2"):
    statement = (
        f"wherever the arm reaches the target, sphere {int(pair[0])} ({link}) is inside {name}, "
        f"{1e3 * margin:.1f} mm deeper than needed, covering 0.1 mm, 0.001 rad and {1e3 * allowed:g} mm of penetration"
    )
    return certificate(
        "last_link", "geometry", statement, margin, tolerances=[1e-4, 1e-3, allowed], pair=pair
    )


def test_too_far_by_a_known_length(tmp_path):
    asked = problem(tmp_path, planar((0.5, 0.4)), (1.0, 0.0, 0.0))
    # last point: joint 2's origin, 0.4 from the tool, which stands along x; 0.6 away, the first link is 0.5 long
    check(asked, reach(0.1 - 1e-4 - 4e-4 - 1e-9, [0.0, 0.0]))
    for margin in (0.0985, 0.101, 0.0, -0.1):
        with pytest.raises(RefusedError, match="margin"):
            check(asked, reach(margin, [0.0, 0.0]))


def test_too_near_by_a_known_length(tmp_path):
    asked = problem(tmp_path, planar((0.9, 0.2)), (0.1, 0.0, 0.0), about_z(0.0))
    check(asked, reach(0.9 - 0.1 - 1e-4 - 2e-4 - 1e-9, [0.0, 0.0]))


def test_what_is_reached_is_not_proved_away(tmp_path):
    asked = problem(tmp_path, planar((0.5, 0.4)), (0.9, 0.0, 0.0))
    for slides in ([0.0, 0.0], [10.0, -10.0], [0.3, 0.2]):
        with pytest.raises(RefusedError, match="nothing is proved"):
            check(asked, reach(1e-3, slides))


def test_a_sphere_that_the_target_puts_into_a_ball(tmp_path):
    robot = planar(
        (0.5, 0.4), spheres=[(2, 0.2, 0.0, 0.0, 0.05), (1, 0.5, 0.03, 0.0, 0.05), (0, 0.2, 0, 0, 0.05)]
    )
    asked = problem(tmp_path, robot, (0.8, 0.0, 0.0), DOWN, BALL)
    # sphere 0: 0.2 before the tool: at the ball's centre, 0.15 deep; 1e-4 and 1e-3 times 0.2 off
    deep = 0.15 - 1e-4 - 2e-4 - 1e-9
    check(asked, last_link(deep, [0.0, 0.0]))
    check(asked, last_link(deep - 0.01, [0.0, 0.0], allowed=0.01))
    # sphere 1 circles joint 2's axis, which is at 0.4, at 0.03: 0.2 from the ball's centre, 0.05 too far
    with pytest.raises(RefusedError, match="nothing is proved"):
        check(asked, last_link(0.01, [1.0, 0.0], link="link1"))
    with pytest.raises(RefusedError, match="which the target does not place"):
        check(asked, last_link(0.01, [2.0, 0.0], link="base"))
    nearer = problem(tmp_path, robot, (0.93, 0.0, 0.0), DOWN, BALL)
    check(nearer, last_link(0.15 - 0.07 - 0.03 - 1e-4 - 4e-4 - 1e-9, [1.0, 0.0], link="link1"))


@pytest.mark.parametrize("pair", [[3.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.5, 0.0], [1e50, 0.0]])
def test_an_index_that_is_none_is_refused(tmp_path, pair):
    robot = planar((0.5, 0.4), spheres=[(2, 0.2, 0.0, 0.0, 0.05)])
    with pytest.raises(RefusedError):
        check(problem(tmp_path, robot, (0.8, 0.0, 0.0), DOWN, BALL), last_link(0.1, pair))


def test_what_a_file_says_is_compared(tmp_path):
    asked = problem(tmp_path, planar((0.5, 0.4)), (1.0, 0.0, 0.0))
    good = reach(0.1 - 5e-4, [0.0, 0.0])
    check(asked, good)
    for change in (
        {"scope": "geometry"},
        {"statement": good["statement"] + "."},
        {"statement": "the target is far away"},
        {"kind": "farkas"},
        {"kind": "none"},
        {"margin": True},
        {"margin": "0.1"},
        {"format": "workcell-certificate/2"},
        {"data": {**good["data"], "more": {"shape": [0], "values": []}}},
        {"data": {"slides": good["data"]["slides"]}},
    ):
        with pytest.raises(RefusedError):
            check(asked, good | change)


@pytest.mark.parametrize("tolerances", [[1e-5, 1e-3, 0], [1e-4, 1e-4, 0], [2, 1e-3, 0], [1e-4, 1e-3, -1]])
def test_tolerances_narrower_than_the_problem_are_refused(tmp_path, tolerances):
    asked = problem(tmp_path, planar((0.5, 0.4)), (1.0, 0.0, 0.0))
    with pytest.raises(RefusedError, match=r"tolerances|penetration"):
        check(asked, certificate("reach", "kinematics", "", 0.1, tolerances=tolerances, slides=[0, 0]))


@pytest.mark.parametrize(
    "change",
    [
        {"format": "workcell-ikset/2"},
        {"robot": None},
        {"robot": {**planar((0.5,)), "joints": []}},
        {"robot": {**planar((0.5,)), "spheres": 3}},
        {"robot": {**planar((0.5,)), "spheres": [[2, 0, 0, 0, 0.1]]}},
        {"robot": {**planar((0.5,)), "spheres": [[0.5, 0, 0, 0, 0.1]]}},
        {"robot": {**planar((0.5,)), "spheres": [[1, 0, 0, 0, -0.1]]}},
        {"robot": {**planar((0.5,)), "joints": [joint((0, 0, 0), axis=(0, 0, 0))]}},
        {"robot": {**planar((0.5,)), "joints": [joint((0, 0, 0), quat=(0, 0, 0, 0))]}},
        {"robot": {**planar((0.5,)), "joints": [joint((0, 0, 0), lower=1.0, upper=0.0)]}},
        {"robot": {**planar((0.5,)), "joints": [joint((0, 0, 10**400))]}},
        {"robot": {**planar((0.5,)), "joints": [joint((0, 0, float("nan")))]}},
        {"problems": {}},
        {"problems": [1]},
        {"problems": [{"id": 1}]},
        {"problems": [{"id": "p"}, {"id": "p"}]},
        {"problems": [{"id": "p", "target": {"xyz": [0, 0], "quat": DOWN}}]},
        {"problems": [{"id": "p", "target": {"xyz": [0, 0, 0], "quat": DOWN}, "obstacles": []}]},
        {"problems": [{"id": "p", "target": {"xyz": [0, 0, 0], "quat": DOWN}, "obstacles": {"boxes": 1}}]},
        {"problems": [{"id": "p", "target": {"xyz": [0, 0, 0], "quat": DOWN}, "obstacles": {"boxes": [1]}}]},
    ],
)
def test_a_set_that_is_none_is_refused(tmp_path, change):
    document = problem_set(planar((0.5,)), ((0.5, 0.0, 0.0), DOWN))
    file = tmp_path / "set.json"
    file.write_text(json.dumps(document))
    assert list(read_problems(file)) == ["p0"]
    file.write_text(json.dumps(document | change))
    with pytest.raises(RefusedError):
        read_problems(file)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        '{"a": 1, "a": 2}',
        "[" * 20 + "]" * 20,
        "[" * 100_000,
        "9" * 400,
        '{"format": "workcell-ikset/1"}',
    ],
)
def test_texts_that_are_no_sets_are_refused(tmp_path, text):
    file = tmp_path / "set.json"
    file.write_text(text)
    with pytest.raises(RefusedError):
        read_problems(file)


def test_a_pipe_and_a_folder_are_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for file in (tmp_path / "pipe", tmp_path, tmp_path / "none", tmp_path / "nul\0"):
        with pytest.raises(RefusedError):
            read_problems(file)
