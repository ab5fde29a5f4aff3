"""Methods that know the skin need the skin."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from kiribench.cli.design import _on_skin
from kiribench.design.on_skin import KNEE_METHODS, design_on_skin
from kiribench.errors import UsageError


def test_a_table_has_no_skin(tmp_path: Path) -> None:
    none: Any = None
    table = tmp_path / "targets.tsv"
    table.write_text("row\tcol\n")
    for method in KNEE_METHODS:
        with pytest.raises(UsageError) as error:
            _on_skin(method, table, [], none, none, none, None, "auto", quiet=True)
        assert error.value.code == "design-needs-skin"


def test_methods_that_are_not_worn_are_refused() -> None:
    none: Any = None
    with pytest.raises(UsageError) as error:
        design_on_skin("exact", none, none, none)
    assert error.value.code == "method-unknown"
