"""Problem sets and measured tables."""
