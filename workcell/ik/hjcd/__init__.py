"""HJCD-IK: sampling, coordinate descent and polish, with obstacles inside."""
