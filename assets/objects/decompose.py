"""Cuts a concave mesh into convex pieces with coacd, and measures how well pieces fill the mesh.

    python assets/objects/decompose.py                     compare for the mug and the cup (40 s)
    python assets/objects/decompose.py MESH --out FOLDER   cut your watertight mesh into FOLDER/<mesh>_piece_00.stl ...

Settings: coacd's `threshold` is the concavity that a piece may keep (a share of the mesh's size); a lower one gives
more, tighter pieces. Its search is seeded and repeatable. Preprocessing (a remesh for meshes that are not manifold)
is off: it would move the surface, and the meshes here are manifold.

Measured by this script, two cores; volume is that of the pieces' union over the true volume, overshoot the furthest
that a piece stands out of the true surface, gap the furthest that a point of the true surface lies outside all pieces:

    object  pieces by        count   volume  overshoot mm  gap mm
    mug     construction        25    1.060          0.76    0.01
    mug     coacd 0.05          24    1.112          2.07    0.58
    mug     coacd 0.02          44    1.024          1.04    0.10
    cup     construction        17    1.070          0.64    0.00
    cup     coacd 0.05          19    1.123          1.78    0.82
    cup     coacd 0.02          50    1.027          0.51    0.16

At the same count, the pieces that `make_meshes.py` cuts by construction are the tighter ones, and they leave no gaps:
the objects use those. coacd is for meshes that have no construction.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import trimesh

MESHES = Path(__file__).resolve().parent / "meshes"
THRESHOLD = 0.05
SEED = 0


@dataclass(frozen=True, slots=True)
class Fit:
    """How well convex pieces stand for a solid; lengths in metres."""

    pieces: int
    volume_ratio: float
    overshoot: float
    gap: float


def decompose(mesh: trimesh.Trimesh, threshold: float = THRESHOLD, seed: int = SEED) -> list[trimesh.Trimesh]:
    """Convex pieces of a watertight mesh, found by coacd (Wei et al. 2022, approximate convex decomposition).

    Raises ValueError if the mesh is not watertight: it then has no inside to fill.
    """
    import coacd

    if not mesh.is_watertight:
        raise ValueError("the mesh is not watertight: close its holes first (trimesh.repair.fill_holes)")
    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        coacd.Mesh(mesh.vertices, mesh.faces),
        threshold=threshold,
        preprocess_mode="off",
        resolution=2000,
        mcts_nodes=20,
        mcts_iterations=100,
        mcts_max_depth=3,
        max_ch_vertex=64,
        decimate=True,
        seed=seed,
    )
    return [trimesh.convex.convex_hull(vertices) for vertices, _ in parts]


def measure(
    solid: trimesh.Trimesh, pieces: Sequence[trimesh.Trimesh], samples: int = 4000, seed: int = 0
) -> Fit:
    """Fit of the pieces to the solid, from their union's volume and from `samples` points on either surface."""
    union = trimesh.boolean.union(list(pieces), engine="manifold")
    outside = trimesh.sample.sample_surface(union, samples, seed=seed)[0]
    surface = trimesh.sample.sample_surface(solid, samples, seed=seed)[0]
    # trimesh counts distances inside as positive
    overshoot = -trimesh.proximity.signed_distance(solid, outside).min()
    gap = -trimesh.proximity.signed_distance(union, surface).min()
    return Fit(
        len(pieces), float(union.volume / solid.volume), max(float(overshoot), 0.0), max(float(gap), 0.0)
    )


def load(path: Path) -> trimesh.Trimesh:
    """The mesh in a file, equal vertices merged."""
    return trimesh.load(path, force="mesh")


def load_pieces(name: str, folder: Path = MESHES) -> list[trimesh.Trimesh]:
    """The committed pieces of an object, as the convex hulls that a physics engine collides."""
    return [trimesh.convex.convex_hull(load(path)) for path in sorted(folder.glob(f"{name}_piece_*.obj"))]


def compare(names: Sequence[str] = ("mug", "cup")) -> None:
    """Prints the fit of the constructed pieces beside that of coacd's."""
    print(f"{'object':8}{'pieces by':16}{'count':>6}{'volume':>9}{'overshoot mm':>14}{'gap mm':>8}")
    for name in names:
        solid = load(MESHES / f"{name}_visual.obj")
        rows = [("construction", load_pieces(name))]
        rows += [(f"coacd {threshold}", decompose(solid, threshold)) for threshold in (THRESHOLD, 0.02)]
        for label, pieces in rows:
            fit = measure(solid, pieces)
            print(
                f"{name:8}{label:16}{fit.pieces:6d}{fit.volume_ratio:9.3f}"
                f"{1e3 * fit.overshoot:14.2f}{1e3 * fit.gap:8.2f}"
            )


def write(pieces: Sequence[trimesh.Trimesh], stem: str, folder: Path) -> None:
    """One binary STL a piece."""
    folder.mkdir(parents=True, exist_ok=True)
    for index, piece in enumerate(pieces):
        piece.export(folder / f"{stem}_piece_{index:02d}.stl")


def main() -> None:
    parser = argparse.ArgumentParser(description="Cut a concave mesh into convex pieces.")
    parser.add_argument(
        "mesh", nargs="?", type=Path, help="watertight mesh (OBJ, STL, PLY); none: compare on the mug and cup"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("pieces"), help="folder for the pieces (default: pieces)"
    )
    parser.add_argument(
        "--threshold", type=float, default=THRESHOLD, help="concavity a piece may keep, 0.01 .. 1"
    )
    parser.add_argument("--seed", type=int, default=SEED)
    args = parser.parse_args()
    if args.mesh is None:
        compare()
        return
    solid = load(args.mesh)
    pieces = decompose(solid, args.threshold, args.seed)
    write(pieces, args.mesh.stem, args.out)
    print(measure(solid, pieces))


if __name__ == "__main__":
    main()
