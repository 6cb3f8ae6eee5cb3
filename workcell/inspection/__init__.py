"""What a model contains that an answer would depend on, said before anything is asked of it."""
