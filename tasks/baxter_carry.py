"""Both arms of Baxter carry a carton over a low wall: a closed chain.

The work is that of `dual_arm_carry`, with other arms on one torso, another load, another bench: its script does it.
"""

from pathlib import Path

from workcell.task.script import load_script

run = load_script(Path(__file__).with_name("dual_arm_carry.toml"))
