"""A decomposition as a recording: geometry, spheres, free space, and how good they are."""

from __future__ import annotations

from pathlib import Path

from workcell.geometry.decompose import Decomposition
from workcell.model.scene import Scene
from workcell.record.write.recording import Recording


def record_decomposition(decomposition: Decomposition, scene: Scene, path: str | Path) -> Path:
    """Write an `.rrd` of a scene and its decomposition; its verdict is `achieved` if all of it was proved.

    Raises:
        OutputError: the file can't be written.
    """
    metrics = decomposition.metrics
    proved = bool(metrics.get("robot_cover_proved", True)) and bool(metrics["obstacle_cover_proved"])
    sentence = "Covers and free space were proved." if proved else "A cover could not be proved."
    with Recording(path, task=f"decompose {scene.name}") as recording:
        recording.log_scene(scene)
        if decomposition.robot is not None:
            recording.log_cover(scene.robot(decomposition.robot_name), decomposition.robot_cover)
        recording.log_obstacle_cover(decomposition.obstacle_cover)
        recording.log_free_space(decomposition.free_space)
        recording.event(0.0, sentence)
        recording.set_result(
            {
                "achieved": proved,
                "status": "PROVED" if proved else "NOT_PROVED",
                "sentence": sentence,
                **metrics,
            }
        )
    return Path(path)
