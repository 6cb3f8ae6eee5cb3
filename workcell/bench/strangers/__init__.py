"""Cells that a stranger might bring, made at random, and what plain MuJoCo says of the answers in them."""
