"""A tool does what a recorded stream of poses says: one pose after the other, none of them known ahead.

Where the stream pauses, says a wrong number, or its clock runs backwards, the arm slows down and holds.
"""

from pathlib import Path

import numpy as np

from workcell import Job, LiveIK, PlanningWorld


def run(job: Job) -> None:
    """Play the stream, hold its last pose, come to rest."""
    scene, task, stream = job.scene, job.scene.task, job.stream
    with job.phase("preparation"):
        worlds = [PlanningWorld.of(scene, robot=name, seed=job.seed) for name in scene.robots]
        live = LiveIK(worlds, margin=task["margin"])
        stream.check_tools(live.names)
        job.say(f"{len(stream.rows)} rows in {stream.end:.2f} s, {len(stream.faults)} of them no goals")
        for fault in dict.fromkeys(stream.faults):
            job.say(f"no goal: {fault}", "WARN")

    with job.phase("execution"):
        simulation = job.simulation()
        late, seconds = task["late_s"], stream.end + task["rest_s"]
        job.follow_goals(
            simulation,
            live,
            lambda t: stream.at(t - late, interpolate=True),
            seconds + late,
            "following the stream",
        )
        errors = np.concatenate([part.position_error for part in simulation.result().live])
        told = errors[np.isfinite(errors)]
        job.summary |= {
            "stream": Path(stream.where).name,
            "stream_rows": len(stream.rows),
            "stream_faults": len(stream.faults),
        }
        job.judge(
            simulation,
            {"the stream is followed": bool(len(told)) and bool(told.mean() <= task["mean_error_m"])},
        )
