"""Designs against a reference: simulated flat or worn, measured in a tensile test."""
