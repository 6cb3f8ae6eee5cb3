"""What the command's exit status means."""

DONE = 0
"""Done, and achieved."""
NOT_ACHIEVED = 1
"""Ran, but no solution was found, the task failed, or an answer was refused."""
BAD_INPUT = 2
"""Bad usage or bad input, with one clear message."""
IMPOSSIBLE = 3
"""Proved impossible (`ik`, `run`)."""
UNFORESEEN = 70
"""Something that nobody foresaw: the details are in a file, to be reported."""
INTERRUPTED = 130
"""Interrupted by the user."""
