"""Numbers of the shapes that obstacles have, in the arrays that the solvers' and planners' kernels take.

Numbers alone, so that those who fill the arrays import no compiler. The judge and the checker of proofs by branch and
bound know shapes for themselves: they share nothing with solvers.
"""

from __future__ import annotations

BOX, BALL, CAPSULE, CYLINDER, ELLIPSOID, HALFSPACE, HULL = range(7)
KINDS = {
    "box": BOX,
    "sphere": BALL,
    "capsule": CAPSULE,
    "cylinder": CYLINDER,
    "ellipsoid": ELLIPSOID,
    "halfspace": HALFSPACE,
    "hull": HULL,
}
"""By the names of `workcell.geometry.types.PieceKind`."""
