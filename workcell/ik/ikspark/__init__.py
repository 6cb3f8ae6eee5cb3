"""IKSPARK (Wu and Tron): inverse kinematics as rank-1 points of a convex set."""
