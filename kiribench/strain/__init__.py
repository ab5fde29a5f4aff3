"""Two poses to skin strain, cell by cell, with uncertainty."""
