"""Obstacles in the relaxation: spheres in regions of free space, and half-spaces where those do not answer."""
