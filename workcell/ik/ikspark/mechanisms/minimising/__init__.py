"""Rank minimisation beyond Problem 3: with a cost that may grow (Problems 2b and 4)."""
