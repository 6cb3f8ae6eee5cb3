"""One numbering of shapes: every kind of piece has a number, and filling arrays with them loads no compiler."""

import subprocess
import sys
from typing import get_args

from workcell.geometry.types import PieceKind
from workcell.ik.branch.arrays import KNOWN
from workcell.kernels.shape_kinds import KINDS


def test_every_kind_of_piece_has_a_number_of_its_own():
    assert set(KINDS) == set(get_args(PieceKind))
    assert sorted(KINDS.values()) == list(range(len(KINDS)))
    assert set(KNOWN) < set(KINDS)


def test_the_numbers_come_without_the_compiler():
    code = (
        "import sys, workcell.geometry.packing, workcell.ik.branch.arrays; sys.exit('numba' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
