"""GPyTorch, imported without the deprecation warnings that torch raises inside it."""

from __future__ import annotations

import warnings

with warnings.catch_warnings():
    # linear_operator decorates with torch.jit.script, which torch 2.13 deprecates.
    warnings.simplefilter("ignore", DeprecationWarning)
    import gpytorch

__all__ = ["gpytorch"]
