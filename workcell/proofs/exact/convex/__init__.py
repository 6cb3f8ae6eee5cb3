"""`farkas/2` and `cidgik/2` (sections 7 and 8): multipliers that add up to a contradiction."""
