"""Records and estimates to pandas and xarray and back, to the bit, with units in attrs."""

import sys

import numpy as np
import pytest

import ambkit
from ambkit import Estimate, Machine, Record
from ambkit.base.errors import AmbkitError, RecordError

pandas = pytest.importorskip("pandas")
xarray = pytest.importorskip("xarray")

BEARING = Machine.preset("zittau_axial")
RECORD = ambkit.simulate(
    BEARING, ambkit.scenario_for(BEARING, step="0.1 mm", duration="20 ms")
).record
ARRAYS = (
    "t", "mean", "innovation", "innovation_variance", "k_i", "k_s", "status", "covariance",
    "scale", "scale_variance",
)  # fmt: skip


def bits(array):
    return None if array is None else (array.dtype, array.shape, array.tobytes())


def same(one, other):
    signals = all(bits(one[name]) == bits(other[name]) for name in ("t", *one))
    return signals and list(one) == list(other) and (one.units, one.meta) == (
        other.units, other.meta,
    )  # fmt: skip


def test_a_record_comes_back_to_the_bit():
    lost = Record(
        RECORD.t, {"y": np.where(RECORD.t < 1e-3, np.nan, RECORD["y"]), "T": RECORD["v"] + 300},
        {"T": "K"}, {"source": "rig", "nested": {"a": [1, None]}},
    )  # fmt: skip
    for record in (RECORD, lost):
        assert same(record, Record.from_pandas(record.to_pandas()))
        assert same(record, Record.from_xarray(record.to_xarray()))
    part = lost.to_pandas().iloc[5:20]
    assert same(Record.from_pandas(part), lost.between(5e-4, 20e-4))


def test_units_are_in_attrs():
    frame, dataset = RECORD.to_pandas(), RECORD.to_xarray()
    assert frame.attrs["units"] == {"t": "s", **RECORD.units}
    assert frame.index.name == "t"
    assert {name: dataset[name].attrs["units"] for name in dataset} == RECORD.units
    assert dataset.t.attrs["units"] == "s"
    assert isinstance(dataset.attrs["ambkit"], str)  # netCDF holds no dictionary
    estimate = ambkit.KalmanFilter(BEARING).run(RECORD).to_pandas()
    assert estimate.attrs["units"]["f_d"] == "N"


@pytest.mark.parametrize("covariance", [False, True])
@pytest.mark.parametrize("kind", ["KalmanFilter", "AugmentedKalmanFilter", "LowPass"])
def test_an_estimate_comes_back_to_the_bit(kind, covariance):
    made = getattr(ambkit, kind)(BEARING).run(RECORD, covariance=covariance)
    frame, dataset = made.to_pandas(), made.to_xarray()
    assert frame["x"].to_numpy().tobytes() == np.ascontiguousarray(made.x).tobytes()
    for back in (Estimate.from_pandas(frame), Estimate.from_xarray(dataset)):
        for name in ARRAYS:
            assert bits(getattr(back, name)) == bits(getattr(made, name)), name
        assert (back.states, back.estimator) == (made.states, made.estimator)
    if made.covariance is not None:
        assert frame["cov_x_x"].to_numpy() == pytest.approx(made.std("x") ** 2)
        with pytest.raises(RecordError, match="is not a complete estimate"):
            Estimate.from_pandas(frame.drop(columns="cov_x_v"))
    with pytest.raises(RecordError, match="'k_i' is missing"):
        Estimate.from_pandas(frame.drop(columns="k_i"))


def test_somebody_elses_frame_is_converted():
    t = [0.0, 1.0, 2.0]
    frame = pandas.DataFrame({"t": t, "y": [1, 2, 3], "speed": [1.0, 2.0, 3.0]})
    record = Record.from_pandas(frame, units={"t": "ms", "y": "µm", "speed": "mm/ms"})
    assert record.t == pytest.approx([0.0, 1e-3, 2e-3])
    assert record["y"] == pytest.approx([1e-6, 2e-6, 3e-6])
    assert record.units == {"y": "m", "speed": "m/s"}
    for index in (
        pandas.to_datetime(["2026-01-01 12:00:00", "2026-01-01 12:00:01", "2026-01-01 12:00:02"]),
        pandas.to_timedelta([0, 1, 2], unit="s"),
    ):
        assert Record.from_pandas(frame[["y"]].set_index(index)).t.tolist() == t
    later = pandas.to_timedelta([5, 6, 7], unit="s")  # a span of time has a zero, a date has none
    assert Record.from_pandas(frame[["y"]].set_index(later)).t.tolist() == [5.0, 6.0, 7.0]
    dataset = xarray.Dataset({"y": ("t", t, {"units": "mm"})}, {"t": ("t", t, {"units": "ms"})})
    read = Record.from_xarray(dataset)
    assert (read.t[-1], read["y"][-1]) == pytest.approx((2e-3, 2e-3))


def wide():
    return xarray.Dataset({"y": (("t", "z"), np.zeros((2, 2)))}, {"t": [0.0, 1.0]})


T = {"t": [0.0, 1.0]}


@pytest.mark.parametrize(
    ("read", "message"),
    [
        (lambda: Record.from_pandas(3), "a DataFrame of pandas is needed, this is a int"),
        (lambda: Record.from_pandas(pandas.DataFrame({"y": [1, 2]})), "the DataFrame has no time: "
         "its index, or a column, must be t [s]"),
        (lambda: Record.from_pandas(pandas.DataFrame(T | {"z": [1, 2]})),
         'column z has no unit; give it, as in units={"z": "mm"}'),
        (lambda: Record.from_pandas(pandas.DataFrame(T | {"y": [1, 2]}), units={"q": "m"}),
         "units: there is no column q; there are t, y"),
        (lambda: Record.from_pandas(pandas.DataFrame(T | {"y": [1, 2]}), units={"y": "N"}),
         "column y: N cannot be converted to m"),
        (lambda: Record.from_pandas(pandas.DataFrame(T | {"y": [None, {}]})),
         "column y must hold numbers, holds object"),
        (lambda: Record.from_xarray(RECORD.to_pandas()),
         "a Dataset of xarray is needed, this is a DataFrame"),
        (lambda: Record.from_xarray(xarray.Dataset()),
         "the Dataset has no time: it must have the coordinate t [s]"),
        (lambda: Record.from_xarray(wide()), "variable y must be over t alone, is over ('t', 'z')"),
        (lambda: Record.from_xarray(RECORD.to_xarray().assign_attrs(ambkit="{")),
         'attrs["ambkit"] of the Dataset is no JSON object'),
        (lambda: Estimate.from_pandas(RECORD.to_pandas()),
         "is not a complete estimate of ambkit: 'states' is missing"),
    ],
)  # fmt: skip
def test_what_is_no_record_is_refused_in_a_line(read, message):
    with pytest.raises(RecordError) as caught:
        read()
    assert str(caught.value) == message


@pytest.mark.parametrize("library", ["pandas", "xarray"])
def test_a_missing_library_is_reported_in_a_line(library, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(AmbkitError) as caught:
        getattr(RECORD, f"to_{library}")()
    assert str(caught.value).endswith(f"needs {library}: pip install 'ambkit[{library}]'")
    assert "\n" not in str(caught.value)
