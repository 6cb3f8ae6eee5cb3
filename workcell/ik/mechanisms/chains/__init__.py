"""Serial chains between the world and what a goal fixes: what one can't do, the whole mechanism can't."""
