"""The parts of a subject's page, one topic a file; each gives HTML or nothing."""
