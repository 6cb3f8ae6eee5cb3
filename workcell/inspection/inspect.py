"""All that is found out about a scene, in the order in which it is told."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING

from workcell.inspection.findings import Finding
from workcell.inspection.joints import joint_findings, loop_findings
from workcell.inspection.meshes import mesh_findings
from workcell.inspection.parts import geometry_findings, stray_findings, tool_findings
from workcell.inspection.physics import actuator_findings, option_findings, warning_findings
from workcell.inspection.touching import touching_findings

if TYPE_CHECKING:
    from workcell.model.scene import Scene


def inspect_scene(scene: Scene) -> tuple[Finding, ...]:
    """Facts, what to beware of, and what is wrong with a scene or a robot alone."""
    model = scene.model
    return tuple(
        chain(
            joint_findings(scene),
            loop_findings(model),
            tool_findings(scene),
            geometry_findings(scene),
            touching_findings(scene),
            stray_findings(scene),
            mesh_findings(model),
            option_findings(model),
            actuator_findings(scene),
            warning_findings(scene),
        )
    )
