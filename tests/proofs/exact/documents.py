"""Small problem sets and certificates as JSON documents, written by hand."""

from __future__ import annotations

import json
import math

import numpy as np
from scipy.spatial.transform import Rotation

from workcell.proofs.exact.problems import Problem, read_problems

DOWN = [1.0, 0.0, 0.0, 0.0]


def joint(xyz, axis=(0.0, 0.0, 1.0), lower=-math.pi, upper=math.pi, quat=DOWN):
    return {
        "name": "j",
        "xyz": list(xyz),
        "quat": list(quat),
        "axis": list(axis),
        "lower": lower,
        "upper": upper,
    }


def planar(lengths, limit=math.pi, spheres=()):
    """An arm in the plane; link k along x, the tool at its end."""
    joints = [joint((before, 0.0, 0.0), lower=-limit, upper=limit) for before in (0.0, *lengths[:-1])]
    return {
        "name": "planar",
        "joints": joints,
        "tool": {"xyz": [lengths[-1], 0.0, 0.0], "quat": DOWN},
        "spheres": [list(row) for row in spheres],
    }


def about_z(angle):
    return [math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]


def problem_set(robot, *targets, obstacles=None):
    """`targets` are (xyz, quat)."""
    return {
        "format": "workcell-ikset/1",
        "set": "by hand",
        "robot": robot,
        "problems": [
            {
                "id": f"p{k}",
                "target": {"xyz": list(xyz), "quat": list(quat)},
                "obstacles": obstacles or {},
            }
            for k, (xyz, quat) in enumerate(targets)
        ],
    }


def problem(folder, robot, xyz, quat=DOWN, obstacles=None) -> Problem:
    """One problem, read from a file."""
    file = folder / "set.json"
    file.write_text(json.dumps(problem_set(robot, (xyz, quat), obstacles=obstacles)))
    return read_problems(file)["p0"]


def array(values):
    numbers = np.array(values, dtype=float)
    return {"shape": list(numbers.shape), "values": numbers.ravel().tolist()}


def certificate(kind, scope, statement, margin, **data):
    return {
        "format": "workcell-certificate/1",
        "kind": kind,
        "scope": scope,
        "statement": statement,
        "margin": margin,
        "problem_hash": "0" * 64,
        "data": {name: value if isinstance(value, dict) else array(value) for name, value in data.items()},
    }


def tree_statement(leaves, clearance=None):
    wanted = "" if clearance is None else (
        f" with a clearance of {1e3 * clearance:.4g} mm or more (up to 0.01 mm beyond the wanted one)"
    )  # fmt: skip
    return (
        f"No configuration{wanted} brings the tool within 0.1 mm and 0.001 rad of its target: "
        f"each of the {leaves} boxes that cover all joint angles is excluded."
    )


def tree(problem, nodes=(-1.0,), splits=(), named=(), clearance=0.0, **changes):
    """A tree whose root is every joint's range, a little widened."""
    joints = problem.arm.joints
    leaves = sum(node < 0 for node in nodes)
    data = {
        "tree": list(nodes),
        "splits": list(splits),
        "blocked": {"shape": [2, len(named)], "values": [float(v) for row in zip(*named, strict=True) for v in row]},
        "root": [[j.lower - 2e-6 for j in joints], [j.upper + 2e-6 for j in joints]],
        "inflation": [1e-4, 1e-3],
        "clearance": [clearance],
        "seal": [0.0] * 8,
    }  # fmt: skip
    scope = "geometry" if named else "kinematics"
    statement = tree_statement(leaves, clearance if named else None)
    return certificate("branch", scope, statement, 1e-4, **(data | changes))


def matrix(quat):
    w, x, y, z = np.array(quat) / np.linalg.norm(quat)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion(R):
    x, y, z, w = Rotation.from_matrix(R).as_quat()
    return [w, x, y, z]
