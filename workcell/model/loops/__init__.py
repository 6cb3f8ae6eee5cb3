"""Passive loops: joints that nothing drives and that connects, welds and tendons of the model determine."""
