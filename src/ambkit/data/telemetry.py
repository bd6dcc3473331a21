"""Frames that a controller sent: ``core/include/ambkit/telemetry.h`` has their form."""

from __future__ import annotations

import json
import os
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.base.errors import RecordError
from ambkit.data.record import Record

SYNC = b"AMBF"
_AROUND = 5  # words of a frame besides its numbers


def read_telemetry(
    received: str | os.PathLike[str] | bytes, layout: str | os.PathLike[str]
) -> Record:
    """Read the frames in what a controller has sent.

    Frames are found wherever they begin; bytes in between, and frames whose CRC is wrong, are left
    out. Samples of which no frame arrived are NaN.

    Parameters
    ----------
    received : path or bytes
        As they arrived.
    layout : path
        ``telemetry.json`` of the export.

    Returns
    -------
    Record
        The states, innovations and their variances, and of a whole controller its currents and
        ``mode``; ``status`` as the sum of its flags, ``usable`` where the estimate may be fed back
        [1]. ``meta`` has how many samples are ``missing`` and how many bytes were ``skipped``.

    Raises
    ------
    RecordError
        A file that is not there or no layout; no two frames of this export.
    """
    told = _layout(Path(layout))
    bytes_ = received if isinstance(received, bytes) else _bytes(Path(received))
    numbers = told["numbers"]
    length = 4 * (len(numbers) + _AROUND)
    frames, others, used = [], 0, 0
    at = bytes_.find(SYNC)
    while 0 <= at <= len(bytes_) - length:
        frame = bytes_[at : at + length]
        right = zlib.crc32(frame[:-4]).to_bytes(4, "little") == frame[-4:]
        if right and int.from_bytes(frame[4:8], "little") == told["layout"]:
            frames.append(frame)
            used += length
        others += int(right) - int(right and frames[-1:] == [frame])
        at = bytes_.find(SYNC, at + (length if right else 1))
    if len(frames) < 2:
        found = f"{others} of another export" if others else "none of any"
        raise RecordError(
            f"there must be two frames at least of {told['prefix']} ({Path(layout).name}); there "
            f"{'is one' if frames else 'are none'}, and {found}"
        )
    words = np.frombuffer(b"".join(frames), "<u4").reshape(len(frames), -1)
    return _record(words, told, len(bytes_) - used)


def _record(words: Any, told: dict[str, Any], skipped: int) -> Record:
    """Return the frames on an even grid of samples."""
    count = np.concatenate([[0], np.cumsum(np.diff(words[:, 2]).astype("<u4").astype(np.int64))])
    if not (np.diff(count) > 0).all() or count[-1] > 100 * len(count) + 1000:
        raise RecordError("the frames' counts do not go on: the controller began anew in between")
    n = int(count[-1]) + 1

    def placed(values: Any) -> Any:
        found = np.full(n, np.nan)
        found[count] = values
        return found

    values = words[:, 4:-1].copy().view("<f4").astype(float)
    signals = {each["name"]: placed(values[:, k]) for k, each in enumerate(told["numbers"])}
    units = {each["name"]: each["unit"] for each in told["numbers"]}
    flags = words[:, 3]
    more = {"status": flags & 0xFFFF, "mode": flags >> 16 & 0xFF, "usable": flags >> 24 & 1}
    if not any(name.startswith("coil_0") for name in signals):
        del more["mode"]
    signals |= {name: placed(each) for name, each in more.items()}
    t = (int(words[0, 2]) + np.arange(n)) * told["sampling_time"]
    meta = {"source": told["prefix"], "missing": n - len(words), "skipped": skipped}
    return Record(t, signals, units | dict.fromkeys(more, "1"), meta)


def _layout(path: Path) -> dict[str, Any]:
    text = _bytes(path)
    try:
        told: dict[str, Any] = json.loads(text)
        if not {"prefix", "layout", "sampling_time", "numbers"} <= set(told):
            raise ValueError
    except (ValueError, TypeError) as error:
        raise RecordError(f"{path}: is not the telemetry.json of an export") from error
    return told


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror}") from error
