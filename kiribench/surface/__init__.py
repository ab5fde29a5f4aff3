"""Scans as triangle meshes: read, check, repair, locate points, measure geodesics."""
