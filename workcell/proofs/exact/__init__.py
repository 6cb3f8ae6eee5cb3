"""The second checker: problem sets, answers and certificates by `docs/proofs.md` alone, in whole numbers.

It imports nothing of workcell. Every number is a whole multiple of a power of two, every rounding goes outwards,
and where no irrational number enters, numbers are fractions. It is slow and simple, and meant to be read beside the
document, whose rules its comments name.
"""
