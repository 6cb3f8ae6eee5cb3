"""Problem sets: files of many problems, their answers and paths, written line by line and re-checked."""
