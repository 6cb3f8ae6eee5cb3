"""Recordings: written while a task runs, reviewed without a screen. The only layer that imports rerun."""
