"""Result of a verb, and its output: one teller for each form."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base import escaping, files
from ambkit.base.errors import AmbkitError
from ambkit.result.row import Row, Stated, singles
from ambkit.result.showing import Plotted

if TYPE_CHECKING:
    import pandas

    from ambkit.result.report import Figure

ENDINGS = "must end in .json, .csv, .tex, .html, .png, .svg or .pdf"


class Result(Stated, Plotted):
    """A result, written in every form from one statement."""

    __slots__ = ()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {escaping.one_line(self.finding)}>"

    def to_dict(self) -> dict[str, Any]:
        """Return rows, by section and object, and series as plain data, in SI.

        Returns
        -------
        dict
            Finding, notes, rows and series.
        """
        results: dict[str, Any] = {"finding": self.finding, "notes": list(self.notes)}
        for row in self.rows:
            place = results
            *within, key = row.key.split(".")
            for name in (*row.section, *([row.of] if row.of else []), *within):
                place = place.setdefault(name, {})
            place |= _stated(replace(row, key=key))
        adequacy = getattr(self, "adequacy", None)  # of a filter in it
        if isinstance(adequacy, list | tuple):
            results["adequacy"] = [finding._asdict() for finding in adequacy]
        return _merged(results, self.series)

    def to_json(self) -> str:
        """Return `to_dict` as JSON; non-finite numbers are null.

        Returns
        -------
        str
            The text.
        """
        return escaping.json_text(plain(self.to_dict()), indent=2, allow_nan=False)

    def to_pandas(self) -> pandas.DataFrame:
        """Return a table with one line per row, numbers in SI.

        Returns
        -------
        pandas.DataFrame
            With section, key, name, value, unit, error, interval, limit and verdict.
        """
        import pandas

        return pandas.DataFrame(
            {
                "section": ".".join(row.section), "of": row.of, "key": row.key,
                "name": row.name.strip(), "symbol": row.symbol, "value": row.value, "unit": row.si,
                "standard_error": row.error, "low": row.interval and row.interval[0],
                "high": row.interval and row.interval[1], "at": row.at and row.at.value,
                "at_unit": row.at and row.at.unit, "limit": row.limit(), "kept": row.kept,
                "note": row.note,
            }
            for row in singles(self.rows)
        )  # fmt: skip

    def to_latex(self) -> str:
        """Return its tables as LaTeX, for the packages booktabs and textcomp.

        Returns
        -------
        str
            One ``tabular`` for each section.
        """
        from ambkit.result.tables import latex

        return latex(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the result to a file.

        Parameters
        ----------
        path : str or path
            Ends in ``.json``, ``.csv`` or ``.tex``; ``.png``, ``.svg`` or ``.pdf`` for the main
            figure; or ``.html`` for a page. Results with a record write it as ``.csv`` or
            ``.parquet``, those with a machine or a filter as ``.toml``.

        Raises
        ------
        AmbkitError
            The file name has another extension, or the file cannot be written.
        """
        ending = Path(path).suffix
        if ending in (".csv", ".parquet") and (made := self.file()) is not None:
            made.save(path)
        elif ending == ".html":
            self.page(path)
        elif ending in (".png", ".svg", ".pdf"):
            self.figure().save(path)
        elif ending == ".json":
            files.write_text(path, self.to_json() + "\n")
        elif ending == ".csv":
            files.write_text(path, self.to_pandas().to_csv(index=False))
        elif ending == ".tex":
            files.write_text(path, self.to_latex() + "\n")
        elif ending == ".toml":
            self.save_toml(path)
        else:
            raise AmbkitError(f"{path} {ENDINGS}")

    def save_toml(self, path: str | os.PathLike[str]) -> None:
        """Write its machine or filter; raises if it has none.

        Parameters
        ----------
        path : str or path
            Ends in ``.toml``.

        Raises
        ------
        AmbkitError
            There is none.
        """
        raise AmbkitError(f"{path} {ENDINGS}")

    def file(self) -> Any:
        """Return the content of ``.csv`` and ``.parquet``; None: the rows, as ``.csv``."""
        return None

    def page(self, path: str | os.PathLike[str]) -> None:
        """Write the result as a page, with all its tables and figures.

        Parameters
        ----------
        path : str or path
            The page.
        """
        from ambkit.result.page import write_result

        write_result([self], path)

    def figure(self) -> Figure:
        """Return its main figure."""
        return self.figures()[0]

    def _repr_html_(self) -> str:
        """Return a notebook's view: finding, first table, main figure."""
        from ambkit.result.card import card_of

        return card_of(self).html()


def _stated(row: Row) -> dict[str, Any]:
    """Return the data of a row, by JSON keys."""
    more = {
        row.error_key: row.error,
        "interval_95": row.interval,
        "limit": row.least if row.least is not None else row.below,
        "kept": row.kept,
        "note": row.note or None,
    }
    results: dict[str, Any] = {row.key: row.value}
    if row.at is not None:
        results[row.at.key] = row.at.value
    before = "" if row.key == "value" else f"{row.key}_"
    return results | {f"{before}{key}": of for key, of in more.items() if of is not None}


def _merged(first: dict[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    for key, value in second.items():
        if isinstance(value, Mapping) and isinstance(first.get(key), dict):
            _merged(first[key], value)
        else:
            first[key] = value
    return first


def plain(data: Any) -> Any:
    """Convert results to JSON types; non-finite numbers become null."""
    if isinstance(data, dict):
        return {str(key): plain(item) for key, item in data.items()}
    if isinstance(data, list | tuple):
        return [plain(item) for item in data]
    if hasattr(data, "tolist"):  # NumPy array or scalar
        return plain(data.tolist())
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    return str(data) if isinstance(data, Path) else data


@dataclass(frozen=True)
class Document:
    """A text with the same content as data."""

    text: str  #: Text.
    data: Any  #: Content as data.
    notes: Sequence[str] = ()  #: Errors, or remaining steps.
    exit_code: int = 0  #: Exit code of a command.

    def __str__(self) -> str:
        return self.text

    def to_dict(self) -> Any:
        """Return it as plain data."""
        return self.data

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the text to a file."""
        files.write_text(path, self.text)


def json_document(data: Any) -> Document:
    """Return data as a document in JSON."""
    text = escaping.json_text(plain(data), indent=2, allow_nan=False)
    return Document(f"{text}\n", data)


@dataclass(frozen=True, repr=False)
class Statement(Result):
    """One sentence, and its data."""

    finding: str = ""  #: The sentence.
    data: Mapping[str, Any] = field(default_factory=dict)  #: In SI.

    rows = ()
    TITLE = "{0.finding}"

    @property
    def series(self) -> Mapping[str, Any]:
        return self.data
