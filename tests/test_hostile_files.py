"""Logs from strangers: none reads another file, none unpacks to more than there is memory for."""

import hashlib
import re
import tracemalloc

import numpy as np
import pytest

from ambkit import Machine
from ambkit.base import memory_limit
from ambkit.base.errors import AmbkitError, RecordError
from ambkit.data.files.tables import read_log
from ambkit.machine.rotors.matrix_file import read_matrices
from tests import logs

SECRET = "root:x:0:0:root:/root:/bin/bash\n" * 8
TIME = np.arange(100) * 1e-3


def secret(folder):
    path = folder / "secret.txt"
    path.write_text(SECRET, encoding="utf-8")
    return path


def external_storage(file, folder):
    where = [(str(secret(folder)), 0, 128)]
    file.create_dataset("pos", shape=(16,), dtype="f8", external=where)


def external_link(file, folder):
    import h5py

    with h5py.File(folder / "other.h5", "w") as other:
        other["pos"] = np.arange(16.0)
    file["pos"] = h5py.ExternalLink("other.h5", "/pos")


def soft_link_beyond(file, folder):
    import h5py

    external_link(file, folder)
    file.move("pos", "rig/there")
    file["pos"] = h5py.SoftLink("/rig/there")


def virtual(file, folder):
    import h5py

    with h5py.File(folder / "other.h5", "w") as other:
        other["pos"] = np.arange(16.0)
    layout = h5py.VirtualLayout(shape=(16,), dtype="f8")
    layout[:] = h5py.VirtualSource(folder / "other.h5", "pos", shape=(16,))
    file.create_virtual_dataset("pos", layout)


WAYS_OUT = {
    external_storage: "pos has its numbers in .*secret.txt",
    external_link: "pos is a link to another file",
    soft_link_beyond: "rig/there is a link to another file",
    virtual: "pos is made of data sets of other files",
}


@pytest.mark.parametrize("way", WAYS_OUT, ids=lambda way: way.__name__)
@pytest.mark.parametrize("name", ["log.h5", "log.mat"])
def test_hdf5_reads_nothing_beyond_its_file(way, name, tmp_path, call):
    import h5py

    path = tmp_path / name
    with h5py.File(path, "w", userblock_size=512 if name == "log.mat" else 0) as file:
        file["time"] = TIME
        way(file, tmp_path)
    for expected in (None, ("time",), ("pos",)):
        with pytest.raises(RecordError, match=f"^{re.escape(str(path))}: {WAYS_OUT[way]}; nothing"):
            read_log(path, expected)
    told = call("read", "guess", path)
    assert told.code == 2
    assert "root:x" not in told.out + told.err


def test_a_soft_link_within_the_file_does_no_harm(tmp_path):
    import h5py

    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["time"] = TIME
        file["again"] = h5py.SoftLink("/time")
        file["ring"] = h5py.SoftLink("/ring")
    assert list(read_log(tmp_path / "log.h5").arrays) == ["time"]


def test_an_attachment_of_an_mdf_is_not_read(tmp_path, monkeypatch):
    from asammdf import MDF, Signal
    from asammdf.blocks import mdf_v4

    there = secret(tmp_path)
    with MDF(version="4.10") as file:
        beyond = (SECRET.encode(), there, hashlib.md5(SECRET.encode()).digest())
        flags = Signal.Flags.stream_sync  # such an attachment is not embedded
        file.append([Signal(np.sin(TIME), TIME, name="pos", attachment=beyond, flags=flags)])
        file.save(tmp_path / "with.mf4")
    read = []
    extract = mdf_v4.MDF4._extract_attachment

    def told(self, index, **options):
        read.append(index)
        return extract(self, index, **options)

    monkeypatch.setattr(mdf_v4.MDF4, "_extract_attachment", told)
    with MDF(tmp_path / "with.mf4") as file:
        assert SECRET in str(file.get("pos").attachment[0])
    assert read
    read.clear()
    assert "pos" in read_log(tmp_path / "with.mf4").arrays
    assert not read


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setenv(memory_limit.VARIABLE, "5 MB")


def zeros_in(name):
    """What writes a log of 4e6 zeros in a small file of this format."""

    def write(path):
        zeros = np.zeros(4_000_000)
        if name.endswith(".h5"):
            import h5py

            with h5py.File(path, "w") as file:
                file.create_dataset("pos", data=zeros, compression="gzip")
        elif name == "cell.mat":
            from scipy.io import savemat

            cells = np.empty(1, dtype=object)
            cells[0] = zeros
            savemat(path, {"rig": {"log": cells}}, do_compression=True)
        elif name == "short.mat":
            from scipy.io import savemat

            savemat(path, {"pos": zeros.astype(np.uint8)}, do_compression=True)
        elif name == "7.3.mat":
            import h5py

            with h5py.File(path, "w", userblock_size=512) as file:
                file.create_dataset("pos", data=zeros, compression="gzip")
        elif name == "text.parquet":
            import pyarrow as pa
            from pyarrow import parquet

            parquet.write_table(pa.table({"pos": ["x" * 100_000] * 1000}), path)
        elif name.endswith(".parquet"):
            logs.parquet(path, {"pos": zeros})
        else:
            from asammdf import MDF, Signal

            with MDF() as file:
                stamps = np.arange(400_000) * 1e-3
                file.append([Signal(np.zeros(400_000), stamps, name="pos")])
                file.save(path, compression=2, overwrite=True)

    return write


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize(
    "name", ["a.h5", "cell.mat", "short.mat", "7.3.mat", "a.parquet", "text.parquet", "a.mf4"]
)
def test_a_file_that_unpacks_to_too_much_is_refused_before_it_is(name, tmp_path):
    path = tmp_path / name
    zeros_in(name)(path)
    assert path.stat().st_size < 4_100_000
    with pytest.raises(RecordError):
        read_log(path)  # imports its library, which takes memory as well
    tracemalloc.start()
    try:
        with pytest.raises(RecordError) as refused:
            read_log(path)
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()
    said = str(refused.value)
    assert re.match(
        rf"{re.escape(str(path))}: would take (more than )?[\d.]+ [MG]B of memory to read", said
    )
    assert "the limit is 5 MB" in said
    assert f"set {memory_limit.VARIABLE}" in said


def test_the_limit_can_be_raised(tmp_path, monkeypatch):
    zeros_in("a.h5")(tmp_path / "a.h5")
    monkeypatch.setenv(memory_limit.VARIABLE, "63 MB")
    with pytest.raises(RecordError, match="would take 64 MB"):
        read_log(tmp_path / "a.h5")
    monkeypatch.setenv(memory_limit.VARIABLE, "64 MB")
    assert read_log(tmp_path / "a.h5").arrays["pos"].size == 4_000_000


@pytest.mark.parametrize("given", ["5", "-1 GB", "0 GB", "lots", "3 mm"])
def test_a_limit_is_a_size(given, tmp_path, monkeypatch):
    zeros_in("a.h5")(tmp_path / "a.h5")
    monkeypatch.setenv(memory_limit.VARIABLE, given)
    with pytest.raises(AmbkitError, match=f"^{memory_limit.VARIABLE}: "):
        read_log(tmp_path / "a.h5")


def test_a_channel_map_reads_less(tmp_path, monkeypatch):
    import h5py

    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("huge", shape=(10**15,), dtype="f8", chunks=(1000,))
        file["pos"] = TIME
    with pytest.raises(RecordError, match=r"would take 1\.6e\+07 GB .* a channel map that names"):
        read_log(tmp_path / "a.h5")
    assert list(read_log(tmp_path / "a.h5", ("pos",)).arrays) == ["pos"]


@pytest.mark.usefixtures("small")
def test_a_text_that_is_too_long_or_never_ends_is_refused(tmp_path):
    rows = "".join(f"{k * 1e-3:.3f},0.00001\n" for k in range(60_000))
    (tmp_path / "long.csv").write_text(f"t [s],y [m]\n{rows}")
    with pytest.raises(RecordError, match=r"long\.csv: would take 6\.\d* MB of memory to read"):
        read_log(tmp_path / "long.csv")
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    endless = r"is a pipe or a device that does not end within 0\.05 MB"
    with pytest.raises(RecordError, match=rf"zero\.csv: {endless}"):
        read_log(tmp_path / "zero.csv")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    with pytest.raises(AmbkitError, match=rf"zero\.toml: {endless}"):
        Machine.load(tmp_path / "zero.toml")


@pytest.mark.parametrize("ending", ["h5", "mat", "mf4", "npz", "parquet"])
def test_a_binary_format_is_not_read_from_a_device(ending, tmp_path):
    endless = tmp_path / f"zero.{ending}"
    endless.symlink_to("/dev/zero")
    read = read_matrices if ending == "npz" else read_log
    with pytest.raises(RecordError, match=rf"zero\.{ending}: is a pipe or a device"):
        read(endless)


def test_names_of_arrays_are_printable_and_a_map_finds_them(tmp_path):
    import h5py
    import pyarrow as pa
    from pyarrow import parquet
    from scipy.io import savemat

    bad, good = "p\x1b[31mos\n", "p\\x1b[31mos\\n"
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file[bad] = TIME
        file[bad].attrs["unit"] = "mm\x1b"
    parquet.write_table(pa.table({bad: TIME}), tmp_path / "a.parquet")
    savemat(tmp_path / "a.mat", {"rig": {bad: TIME}})
    found = {name: read_log(tmp_path / name) for name in ("a.h5", "a.parquet", "a.mat")}
    assert found["a.h5"].units == {good: "mm\\x1b"}
    assert [next(iter(log.arrays)) for log in found.values()] == [good, good, f"rig.{good}"]
    for name in ("a.h5", "a.parquet"):
        assert list(read_log(tmp_path / name, (good,)).arrays) == [good]
