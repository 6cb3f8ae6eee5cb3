"""Collision-free joint motions between configurations, and to poses."""
