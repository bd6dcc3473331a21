"""Series as DataFrame (units in ``attrs``) or Dataset (``units`` a variable, metadata as JSON)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError, library
from ambkit.data.signals import UNITS, to_si

if TYPE_CHECKING:
    import pandas
    import xarray

KEY = "ambkit"  #: Attribute of an xarray data set with everything that is no variable, as JSON.


class Series(NamedTuple):
    """Columns over time with units and metadata."""

    t: Array
    columns: Mapping[str, NDArray[Any]]
    units: Mapping[str, str]
    about: Mapping[str, Any]


class Framed:
    """Conversion of series over time to and from the frames of other libraries."""

    __slots__ = ()

    def _series(self) -> Series:
        raise NotImplementedError

    @classmethod
    def _of_series(cls, series: Series, units: Mapping[str, str] | None) -> Self:
        raise NotImplementedError

    def to_pandas(self) -> pandas.DataFrame:
        """Return everything as a DataFrame over the time [s], in SI.

        Returns
        -------
        pandas.DataFrame
            Its ``attrs`` hold ``units`` and metadata.

        Raises
        ------
        AmbkitError
            pandas is not installed (``pip install 'ambkit[pandas]'``).
        """
        series = self._series()
        pandas = library("pandas", "a DataFrame", "pandas")
        index = pandas.Index(series.t, name="t")
        frame = pandas.DataFrame(dict(series.columns), index=index)
        frame.attrs = {"units": {"t": "s"} | dict(series.units)} | dict(series.about)
        return frame

    @classmethod
    def from_pandas(cls, frame: pandas.DataFrame, units: Mapping[str, str] | None = None) -> Self:
        """Convert a DataFrame; that of `to_pandas` restores the exact values.

        Parameters
        ----------
        frame : pandas.DataFrame
            The index is the time, in seconds or as a pandas time; or the column ``t``.
        units : mapping of str to str, optional
            Unit of each column, such as ``{"y": "mm"}``; by default ``frame.attrs["units"]``, and
            SI for the standard names. Other units are converted.

        Raises
        ------
        RecordError
            No time, a missing column, or one without unit or numbers; or the record is invalid.
        AmbkitError
            pandas is not installed.
        """
        pandas = library("pandas", "a DataFrame", "pandas")
        if not isinstance(frame, pandas.DataFrame):
            raise RecordError(f"a DataFrame of pandas is needed, this is a {type(frame).__name__}")
        about = {str(key): value for key, value in frame.attrs.items()}
        columns = {str(name): frame[name].to_numpy() for name in frame.columns}
        t = columns.pop("t", None)
        if t is None:
            t = frame.index.to_numpy()
            if frame.index.name != "t" and t.dtype.kind not in "mM":
                raise RecordError(
                    "the DataFrame has no time: its index, or a column, must be t [s]"
                )
        series = _checked(t, columns, dict(about.pop("units", {})), about)
        return cls._of_series(series, units)

    def to_xarray(self) -> xarray.Dataset:
        """Return everything as a Dataset over the coordinate t [s], in SI.

        Returns
        -------
        xarray.Dataset
            Each variable has its ``units``; metadata is JSON in ``attrs``, as netCDF requires.

        Raises
        ------
        RecordError
            JSON cannot represent the metadata.
        AmbkitError
            xarray is not installed (``pip install 'ambkit[xarray]'``).
        """
        series = self._series()
        xarray = library("xarray", "a Dataset", "xarray")
        try:
            about = json.dumps(dict(series.about), ensure_ascii=False)
        except (TypeError, ValueError, RecursionError) as error:
            raise RecordError(f"meta cannot be written as JSON: {error}") from None
        data = {
            name: ("t", values, {"units": series.units[name]})
            for name, values in series.columns.items()
        }
        t = ("t", series.t, {"units": "s"})
        return xarray.Dataset(data, {"t": t}, {KEY: about})  # type: ignore[no-any-return]

    @classmethod
    def from_xarray(cls, dataset: xarray.Dataset, units: Mapping[str, str] | None = None) -> Self:
        """Convert a Dataset; that of `to_xarray` restores the exact values.

        Parameters
        ----------
        dataset : xarray.Dataset
            Variables over the coordinate ``t``.
        units : mapping of str to str, optional
            Unit of each variable; by default ``attrs["units"]``, and SI for the standard names.
            Other units are converted.

        Raises
        ------
        RecordError
            No time, a missing variable, or one without unit or numbers; or the record is invalid.
        AmbkitError
            xarray is not installed.
        """
        xarray = library("xarray", "a Dataset", "xarray")
        if not isinstance(dataset, xarray.Dataset):
            raise RecordError(f"a Dataset of xarray is needed, this is a {type(dataset).__name__}")
        if "t" not in dataset.coords:
            raise RecordError("the Dataset has no time: it must have the coordinate t [s]")
        try:
            about = dict(json.loads(dataset.attrs.get(KEY, "{}")))
        except (TypeError, ValueError):
            raise RecordError(f'attrs["{KEY}"] of the Dataset is no JSON object') from None
        columns, known = {}, {}
        for key, variable in {"t": dataset["t"], **dataset.data_vars}.items():
            name = str(key)
            if variable.dims != ("t",):
                raise RecordError(f"variable {name} must be over t alone, is over {variable.dims}")
            columns[name] = variable.to_numpy()
            if "units" in variable.attrs:
                known[name] = str(variable.attrs["units"])
        series = _checked(columns.pop("t"), columns, known, about)
        return cls._of_series(series, units)


def in_si(series: Series, units: Mapping[str, str] | None = None) -> Series:
    """Convert all columns to SI; values in SI keep their bits."""
    raw_columns = {"t": series.t, **series.columns}
    known_units = UNITS | dict(series.units) | dict(units or {})
    unknown = [name for name in units or {} if name not in raw_columns]
    if unknown:
        raise RecordError(
            f"units: there is no column {unknown[0]}; there are {', '.join(raw_columns)}"
        )
    columns, result = {}, {}
    for name, values in raw_columns.items():
        if (unit := known_units.get(name)) is None:
            raise RecordError(f'column {name} has no unit; give it, as in units={{"{name}": "mm"}}')
        try:
            columns[name], result[name] = to_si(name, unit, values)
        except ValueError as error:
            raise RecordError(f"column {name}: {error}") from None
    t, _ = columns.pop("t"), result.pop("t")
    return Series(t, columns, result, series.about)


def _checked(
    t: NDArray[Any],
    columns: Mapping[str, NDArray[Any]],
    units: Mapping[str, str],
    about: Mapping[str, Any],
) -> Series:
    if t.dtype.kind in "mM":  # times of day or durations, in seconds
        t = (t - t[0] if t.dtype.kind == "M" else t) / np.timedelta64(1, "s")
    for name, values in {"t": t, **columns}.items():
        if values.dtype.kind not in "fiu":
            raise RecordError(f"column {name} must hold numbers, holds {values.dtype}")
    return Series(t, columns, units, about)
