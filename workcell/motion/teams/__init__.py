"""Several arms that hold one object."""
