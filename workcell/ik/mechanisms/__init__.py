"""Questions about mechanisms: goals, regions and contacts of many frames at once, and who judges their answers."""
