"""Tables in files as they stand: CSV, TSV or Parquet, and the JSON sidecar beside them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from kiribench.errors import TableError
from kiribench.schema.strict_json import parse_json, short

if TYPE_CHECKING:
    import pandas as pd


def read_frame(path: Path) -> pd.DataFrame:
    """A CSV, TSV or Parquet table as it stands.

    Raises:
        TableError: there is no such file, it is empty, or it is no table.
    """
    import pandas as pd

    if not path.is_file():
        raise TableError(
            "table-missing", "The table does not exist.", remedy="Check the path.", file=path
        )
    try:
        if path.suffix.lower() in (".parquet", ".pq"):
            frame = pd.read_parquet(path)
        else:
            separator = "\t" if path.suffix.lower() == ".tsv" else ","
            frame = pd.read_csv(path, sep=separator, skipinitialspace=True)
    except (ValueError, OSError, pd.errors.ParserError, UnicodeDecodeError) as error:
        raise TableError(
            "table-unreadable",
            f"The table cannot be read ({short(str(error), 200)}).",
            remedy="Save it as CSV with commas and decimal points, as TSV or as Parquet.",
            file=path,
        ) from error
    frame.columns = [str(name).strip() for name in frame.columns]
    if frame.empty:
        raise TableError(
            "table-empty", "The table has no rows.", remedy="Add one row a step.", file=path
        )
    return frame


def read_sidecar(path: Path) -> dict[str, Any]:
    """The JSON object of the table's stem, empty where there is none.

    Raises:
        TableError: the sidecar is no JSON object.
    """
    sidecar = path.with_suffix(".json")
    if not sidecar.is_file() or sidecar == path:
        return {}
    content, faults = parse_json(sidecar.read_bytes(), file=str(sidecar))
    errors = [fault for fault in faults if fault.severity == "error"]
    if content is None or errors:
        raise TableError.of(errors or faults)
    return content
