"""Keep a proof that a pose can't be reached in a file, and check it again: no solver is asked.

The checker starts from the problem alone and takes the certificate as a hint: one that belongs to another problem, or
whose numbers were touched, is refused with the reason.
"""

import json
import tempfile
from pathlib import Path

from workcell import IKProblem, Pose, load_robot, solve
from workcell.ik.certificate import Certificate
from workcell.ik.check import check_certificate

robot = load_robot("iiwa14")
far = IKProblem(robot, Pose([1.6, 0.0, 0.3], [0.0, 1.0, 0.0, 0.0]))  # metres; the arm is not that long
result = solve(far, seed=0)
print(f"{result.status.value}: {result.certificate.statement}")

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "certificate.json"
    file.write_text(json.dumps(result.certificate.to_json()))
    kept = Certificate.from_json(json.loads(file.read_text()))
    print(
        f"kept in {file.stat().st_size} bytes, of kind {kept.kind}, with a margin of {1e3 * kept.margin:.1f} mm"
    )

refusal = check_certificate(far, kept)
print("checked again: it holds" if refusal is None else f"refused: {refusal}")

near = IKProblem(robot, Pose([0.5, 0.0, 0.5], [0.0, 1.0, 0.0, 0.0]))
print(f"for another pose it is refused: {check_certificate(near, kept)}")
