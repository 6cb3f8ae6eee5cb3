"""All that is found out about a scene, in the order in which it is told."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING

from workcell.errors import ModelError
from workcell.inspection.findings import Finding
from workcell.inspection.joints import joint_findings, loop_findings
from workcell.inspection.mechanisms import mechanism_findings, moved_bodies, scene_mechanism_of
from workcell.inspection.meshes import mesh_findings
from workcell.inspection.parts import geometry_findings, stray_findings, tool_findings
from workcell.inspection.physics import actuator_findings, option_findings, warning_findings
from workcell.inspection.touching import touching_findings

if TYPE_CHECKING:
    from workcell.model.scene import Scene


def inspect_scene(scene: Scene) -> tuple[Finding, ...]:
    """Facts, what to beware of, and what is wrong with a scene, a mechanism or a robot alone."""
    model, mechanism = scene.model, scene_mechanism_of(scene)
    serial = bool(scene.robots)
    moving = (
        frozenset()
        if mechanism is None or isinstance(mechanism, ModelError) or serial
        else moved_bodies(mechanism)
    )
    return tuple(
        chain(
            joint_findings(scene),
            loop_findings(model),
            tool_findings(scene),
            geometry_findings(scene),
            touching_findings(scene),
            stray_findings(scene, moving),
            ()
            if mechanism is None
            else mechanism_findings(mechanism, serial=serial, told=scene.mechanism is not None),
            mesh_findings(model),
            option_findings(model),
            actuator_findings(scene),
            warning_findings(scene),
        )
    )
