"""The drawings of the report, one a file; each takes arrays and gives inline SVG."""
