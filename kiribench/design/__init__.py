"""Cut maps from strain targets: the paper's search, the exact one, balanced forces, the knee."""
