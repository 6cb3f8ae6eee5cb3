"""Joint motions along paths of the tool."""
