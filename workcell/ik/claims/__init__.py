"""What checkers of certificates have in common: the form of numbers, what may be said, and the chain itself."""
