"""Cut maps to files for the laser, and the independent reading of such files."""
