"""A task, from its script to what its run came to."""
