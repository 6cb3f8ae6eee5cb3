"""What the numbers of each kind of proof say in words; they may be any numbers of the right shapes.

Each teller takes the certificate and, where its checker has found that it holds, the problem, and returns lines.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Mapping

import numpy as np

from workcell.geometry.types import obstacle_name
from workcell.ik.certificate import Certificate
from workcell.ik.claims.form import Shape
from workcell.ik.judge.verify import sphere_name
from workcell.ik.problem import IKProblem
from workcell.pose import Array

MOST_NAMED = 6
"""Entries of a list that are named one by one; the rest is counted."""

Line = tuple[str, str]


def _covers(values: Array) -> Line:
    words = f"{1e3 * float(values[0]):g} mm and {float(values[1]):g} rad around the target"
    if len(values) > 2 and values[2]:
        words += f", {1e3 * float(values[2]):g} mm of penetration"
    return "covers", words


def _reach(certificate: Certificate, problem: IKProblem | None) -> list[Line]:
    slides = certificate.data["slides"]
    lines = [_covers(certificate.data["tolerances"])]
    farthest = float(np.abs(slides).max(initial=0.0))
    lines.append(("points", f"one on each of {len(slides)} joint axes, up to {farthest:.3g} m along it"))
    if problem is not None:
        from workcell.ik.elementary.bounds import ReachBound

        bound = ReachBound.of(problem)
        lengths, ends = bound.lengths(slides), bound.ends(slides)
        total, distance = float(lengths.sum() + bound.axes.travel), float(np.linalg.norm(ends))
        told = (
            f"{total:.4g} m along the chain from the first point to the last, {distance:.4g} m at the target"
        )
        lines.append(("lengths", told))
    return [*lines, ("rests on", "offsets and axes of the joints, and the target")]


def _last_link(certificate: Certificate, problem: IKProblem | None) -> list[Line]:
    sphere, piece = certificate.data["pair"].tolist()
    named = f"sphere {sphere:g} and obstacle {piece:g}"
    if problem is not None:
        named = f"{sphere_name(problem, int(sphere))} and {problem.obstacles[int(piece)].name}"
    return [
        _covers(certificate.data["tolerances"]),
        ("pair", named),
        ("rests on", "the last two links, one sphere, one obstacle, and the target"),
    ]


def _branch(certificate: Certificate, problem: IKProblem | None) -> list[Line]:
    data = certificate.data
    tree, blocked = data["tree"], data["blocked"]
    inner, leaves = int(np.count_nonzero(tree >= 0)), Counter(tree[tree < 0].tolist())
    lines = [
        _covers(data["inflation"]),
        (
            "tree",
            f"{len(tree)} nodes, {_depth(tree)} deep: {inner} boxes are split, {len(tree) - inner} are excluded",
        ),
    ]
    if inner:
        joints = Counter(tree[tree >= 0].tolist())
        lines.append(("splits", _counted({_joint(problem, k): count for k, count in joints.items()})))
    reasons = {
        -1.0: "no configuration closes the chain",
        -2.0: "a sphere collides with an obstacle",
        -3.0: "two spheres collide",
    }
    lines.append(
        ("leaves", _counted({reasons.get(code, f"unknown reason {code:g}"): n for code, n in leaves.items()}))
    )
    named = tree[tree <= -2]
    if blocked.shape == (2, len(named)) and len(named):
        pairs = Counter(
            (bool(code == -2), *pair) for code, pair in zip(named, blocked.T.tolist(), strict=True)
        )
        lines.append(("collisions", _counted({_pair(problem, *pair): n for pair, n in pairs.items()})))
    width = data["root"][1] - data["root"][0]
    lines.append(
        ("root", f"{len(width)} joints, {width.min(initial=np.inf):.3g} to {width.max(initial=0.0):.3g} wide")
    )
    rests = "chain, limits and target" + (", spheres and obstacles" if len(named) else "")
    return [*lines, ("rests on", rests)]


def _joint(problem: IKProblem | None, k: float) -> str:
    names = () if problem is None else problem.robot.joint_names
    return names[int(k)] if k in range(len(names)) else f"joint {k:g}"


def _pair(problem: IKProblem | None, with_obstacle: bool, one: float, two: float) -> str:
    if problem is None or problem.cover is None:
        return f"sphere {one:g} with {'obstacle' if with_obstacle else 'sphere'} {two:g}"
    other = problem.obstacles[int(two)].name if with_obstacle else sphere_name(problem, int(two))
    return f"{sphere_name(problem, int(one))} with {other}"


def _depth(tree: Array) -> int:
    """Levels of a tree in pre-order; as far as it goes, if it is none."""
    open_nodes, deepest = [0], 0
    for code in tree.tolist():
        if not open_nodes:
            break
        level = open_nodes.pop()
        deepest = max(deepest, level)
        if code >= 0:
            open_nodes += [level + 1, level + 1]
    return deepest


def _farkas(certificate: Certificate, problem: IKProblem | None) -> list[Line]:
    data = certificate.data
    first, last = data["planar"].tolist()
    used = np.linalg.norm(data["limits"], axis=1)
    n = len(used)
    lines = [
        _covers(data["tolerances"]),
        (
            "links",
            f"{first:g} next to the base and {last:g} next to the target turn about one known axis, the others freely",
        ),
        (
            "multipliers",
            _counted(
                {
                    "of axes that neighbouring links share": int(
                        np.count_nonzero(np.any(data["axes"] != 0.0, axis=1))
                    ),
                    "of the closure of the chain": int(np.any(data["position"] != 0.0)),
                    "of joint limits": int(np.count_nonzero(used) + np.count_nonzero(data["chords"])),
                }
            ),
        ),
    ]
    ends = [k for k, weight in zip((0, n - 1), data["chords"].tolist(), strict=True) if weight > 0.0]
    joints = sorted({*np.flatnonzero(used > 1e-6 * used.max(initial=0.0)).tolist(), *ends})
    rests = "axes and offsets of the joints, and the target"
    if joints:
        rests += f"; the limits of {_listed([_joint(problem, k) for k in joints])}"
    if "places" in data:
        rests += "; the spheres' places in free-space cuboids"
    return [*lines, ("rests on", rests)]


def _cidgik(certificate: Certificate, problem: IKProblem | None) -> list[Line]:
    data = certificate.data
    limits = np.flatnonzero(data["limits"] > 1e-6 * data["limits"].max(initial=0.0))
    lines = [
        _covers(data["tolerances"]),
        ("vectors", f"{data['facts'].shape[1]} columns of the links' rotations and the base's axes"),
        (
            "multipliers",
            _counted(
                {
                    "of joint limits": int(np.count_nonzero(data["limits"])),
                    "of spheres": len(data["rows"]),
                    "of frames": int(np.count_nonzero(np.any(data["frames"] != 0.0, axis=(1, 2)))),
                }
            ),
        ),
    ]
    rests = "axes and offsets of the joints, and the target"
    if len(limits):
        rests += f"; the limits of {_listed([_joint(problem, int(k)) for k in limits])}"
    keys = data["keys"]
    if len(keys):
        named = {
            obstacle_name(problem.obstacles[int(o)]) if problem else f"obstacle {o:g}" for o in keys[:, 1]
        }
        count = len(np.unique(keys[:, 0]))
        rests += f"; {count} sphere{'s' if count != 1 else ''} and {_listed(sorted(named))}"
    if len(data.get("pairs", ())):
        rests += f"; {len(data['pairs'])} pairs of spheres of the robot"
    return [*lines, ("rests on", rests)]


def _solution(certificate: Certificate, problem: IKProblem | None) -> list[Line]:
    data = certificate.data
    half = data["half"]
    lines = [
        (
            "covers",
            f"{1e3 * float(data['tolerances'][0]):g} mm and {float(data['tolerances'][1]):g} rad of error at most",
        ),
        (
            "box",
            f"around {np.round(data['middle'], 4).tolist()}, {half.min(initial=np.inf):.3g} to "
            f"{half.max(initial=0.0):.3g} rad to either side",
        ),
    ]
    joints = data["joints"]
    if len(joints):
        named = _listed([_joint(problem, float(k)) for k in joints])
        lines.append(("exact", f"a solution is in it: Newton's step in {named} maps the box into itself"))
    return [*lines, ("rests on", "chain, limits, target, spheres and obstacles")]


def _counted(counts: Mapping[str, int]) -> str:
    """`12 of this, 3 of that`, the most frequent first."""
    found = sorted(((n, words) for words, n in counts.items() if n), key=lambda item: (-item[0], item[1]))
    told = [f"{n} {words}" for n, words in itertools.islice(found, MOST_NAMED)]
    rest = sum(n for n, _ in found[MOST_NAMED:])
    return "; ".join(told + ([f"{rest} others"] if rest else [])) or "none"


def _listed(names: list[str]) -> str:
    rest = len(names) - MOST_NAMED
    return ", ".join(names[:MOST_NAMED]) + (f" and {rest} more" if rest > 0 else "")


def _mechanism(certificate: Certificate, problem: IKProblem | None) -> list[Line]:
    data = certificate.data
    used = [name for name in data if name not in ("tolerances", "hangs") and np.any(data[name] != 0.0)]
    held = int(np.count_nonzero(data["hangs"] >= 0.0))
    return [
        _covers(data["tolerances"][:2]),
        ("multipliers", f"of {', '.join(used) or 'nothing'}"),
        ("nodes", f"{held} hang by what turns or holds them"),
        ("rests on", "offsets, axes and limits of the joints, and the target"),
    ]


OPTIONAL: Mapping[str, Shape] = {"places": (None, 3), "links": (None,), "pairs": (None, 2), "own": (None,)}
"""Arrays that some certificates of scenes have."""
Teller = Callable[[Certificate, IKProblem | None], list[Line]]
KINDS: Mapping[str, tuple[str, Mapping[str, Shape], Teller | None]] = {
    "reach": (
        "the triangle inequality along points on the joint axes (docs/proofs.md, section 4)",
        {"tolerances": (3,), "slides": (None,)},
        _reach,
    ),
    "last_link": (
        "the target alone puts a sphere inside an obstacle (section 5)",
        {"tolerances": (3,), "pair": (2,)},
        _last_link,
    ),
    "branch": (
        "boxes that cover all joint angles are excluded one by one (section 6)",
        {
            "tree": (None,),
            "splits": (None,),
            "blocked": (2, None),
            "root": (2, None),
            "inflation": (2,),
            "clearance": (1,),
            "seal": (8,),
        },
        _branch,
    ),
    "farkas/2": (
        "a sum of what ties each link's rotation to its neighbours', zero or more at any solution, is below zero for "
        "all rotations (section 7)",
        {
            "tolerances": (2,),
            "planar": (2,),
            "axes": (None, 3),
            "position": (3,),
            "limits": (None, 3),
            "chords": (2,),
        },
        _farkas,
    ),
    "cidgik/2": (
        "a sum of inner products of the links' directions, zero or more at any solution, is below zero for all "
        "directions (section 8)",
        {
            "tolerances": (3,),
            "facts": (None, None),
            "hands": (None, 2),
            "turned": (2, 3),
            "limits": (None,),
            "keys": (None, 2),
            "rows": (None,),
            "S": (None, None),
            "frames": (None, 4, 4),
        },
        _cidgik,
    ),
    "mechanism/1": (
        "a sum of what ties the rotations of a mechanism's links, zero or more at any solution, is below zero for all "
        "rotations (section 12)",
        {
            "tolerances": (4,),
            "hangs": (None,),
            "axes": (None, 3),
            "limits": (None, 3),
            "turns": (None, 3, 3),
            "steps": (None, 3, 3),
            "chords": (None,),
            "closures": (None, 3),
            "welds": (None, 3, 3),
            "positions": (None, 3),
            "rotations": (None, 3, 3),
            "directions": (None, 3),
            "cones": (None,),
            "regions": (None,),
            "links": (None,),
        },
        _mechanism,
    ),
    "solution": (
        "every configuration of a box solves the problem (section 9)",
        {
            "middle": (None,),
            "half": (None,),
            "joints": (None,),
            "inverse": (None, None),
            "tolerances": (3,),
        },
        _solution,
    ),
}
"""Of every kind: its rule in words, its arrays, and what tells of them."""
