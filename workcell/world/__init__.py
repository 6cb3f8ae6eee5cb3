"""A scene as planners see it: covers, obstacle pieces, free space, and the truth behind them."""
