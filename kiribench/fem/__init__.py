"""Plane-stress hyperelasticity of cut sheets: material, mesh with seams, solver, three models."""

from __future__ import annotations
