"""Sphere covers: outer ones that hold the geometry, inner ones inside it, and their proof."""
