"""The whole task: both arms of Baxter carry a carton over a wall, by the script of `dual_arm_carry`."""

from workcell.record.read.review import review
from workcell.task.run import run_task


def test_the_carton_stands_on_the_platform(tmp_path):
    story = []
    result = run_task("baxter_carry", planner="auto", seed=0, out=tmp_path, say=story.append)
    assert result.achieved, result.sentence
    summary = result.summary
    assert summary["placed_error_m"] < 3e-3 and summary["unintended_contacts"] == 0
    assert 0.0 < summary["max_internal_force_n"] < 40.0
    assert summary["conditions"]["the carton stands on the platform"]
    seen = review(result.recording)
    assert seen.achieved and set(seen.manifest["robots"]) == {"left", "right"}
    (carton,) = seen.objects
    assert carton.name == "carton" and carton.moved > 0.2 and carton.rose > 0.1
