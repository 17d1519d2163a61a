"""What both references are fed with: the task table, numbers by formula, golden files. NumPy only."""
