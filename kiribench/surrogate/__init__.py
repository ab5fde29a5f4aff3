"""Surrogates of the design space: (a, b, strain) to Poisson's ratio, one model a file.

Every model is a scikit-learn estimator; the table of them is
:mod:`kiribench.surrogate.registry`, a kept model is read by :func:`load`::

    from kiribench.surrogate import load
    kept = load("gp.safetensors")
    prediction = kept.predict(a_percent=80, b_percent=80, longitudinal_strain=[0.1, 0.2])

Importing this package loads neither torch nor scikit-learn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kiribench.surrogate.keep import fit_table, load, save
    from kiribench.surrogate.kept_model import KeptModel
    from kiribench.surrogate.registry import ModelSpec, make, model_names, spec

__all__ = ["KeptModel", "ModelSpec", "fit_table", "load", "make", "model_names", "save", "spec"]

_KEEP = {"fit_table", "load", "save"}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name in _KEEP:
        from kiribench.surrogate import keep

        return getattr(keep, name)
    if name == "KeptModel":
        from kiribench.surrogate import kept_model

        return kept_model.KeptModel
    from kiribench.surrogate import registry

    return getattr(registry, name)
