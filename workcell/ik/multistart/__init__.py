"""Plain multi-start local search: what every other method is measured against."""
