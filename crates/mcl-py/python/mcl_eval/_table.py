"""Tables of results."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Union

import numpy as np

from . import _native

if TYPE_CHECKING:
    # Neither has types of its own.
    import pandas  # type: ignore[import-untyped, unused-ignore]
    import pyarrow  # type: ignore[import-untyped, unused-ignore]


class Table(Mapping[str, "np.ndarray[Any, Any]"]):
    """Columns by name, arrays of shape (rows,): int64 or uint64, float64 (NaN where a value is not known), bool, or
    objects (str, and None where a value is not known)."""

    def __init__(self, columns: Mapping[str, np.ndarray[Any, Any]]) -> None:
        self._columns = dict(columns)

    def __getitem__(self, name: str) -> np.ndarray[Any, Any]:
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self._columns.values()), ()))

    def __repr__(self) -> str:
        return f"<Table of {self.rows} rows: {', '.join(self)}>"

    def to_pandas(self) -> pandas.DataFrame:
        """The table as a frame of pandas, which has to be installed."""
        import pandas

        return pandas.DataFrame(self._columns)

    def to_arrow(self) -> pyarrow.Table:
        """The table as one of Arrow; pyarrow has to be installed. What is not known is null."""
        import pyarrow

        return pyarrow.table({name: pyarrow.array(column, from_pandas=True) for name, column in self.items()})

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Arrow's protocol for polars, DuckDB and others; by to_arrow."""
        return self.to_arrow().__arrow_c_stream__(requested_schema)


def read_results(folder: Union[str, "os.PathLike[str]"]) -> Table:
    """Read the rows of a study on a data set, from the folder <output>/<study>/<data set>."""
    return Table(_native.read_results(folder))
