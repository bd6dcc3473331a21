"""Frames of a controller, in the format of ``core/include/ambkit/telemetry.h``."""

from __future__ import annotations

import json
import os
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.base import memory_limit
from ambkit.base.errors import RecordError
from ambkit.data.record import Record

SYNC = b"AMBF"
_AROUND = 5  # words of a frame besides its numbers


def read_telemetry(
    received: str | os.PathLike[str] | bytes, layout: str | os.PathLike[str]
) -> Record:
    """Read the frames in a controller's telemetry.

    Frames are found at any position; bytes in between and frames with a wrong CRC are skipped.
    Samples without a frame are NaN.

    Parameters
    ----------
    received : path or bytes
        Received bytes.
    layout : path
        ``telemetry.json`` of the export.

    Returns
    -------
    Record
        States, innovations and their variances; for a complete controller also currents and
        ``mode``; ``status`` as the sum of its flags, ``usable`` if the estimate may be fed back
        [1]. ``meta`` has the number of samples ``missing`` and of bytes ``skipped``.

    Raises
    ------
    RecordError
        A file does not exist or is not a layout, or there are not two frames of this export.
    """
    schema = _layout(Path(layout))
    bytes_ = received if isinstance(received, bytes) else _bytes(Path(received))
    numbers = schema["numbers"]
    length = 4 * (len(numbers) + _AROUND)
    frames, others, used = [], 0, 0
    at = bytes_.find(SYNC)
    while 0 <= at <= len(bytes_) - length:
        frame = bytes_[at : at + length]
        right = zlib.crc32(frame[:-4]).to_bytes(4, "little") == frame[-4:]
        if right and int.from_bytes(frame[4:8], "little") == schema["layout"]:
            frames.append(frame)
            used += length
        others += int(right) - int(right and frames[-1:] == [frame])
        at = bytes_.find(SYNC, at + (length if right else 1))
    if len(frames) < 2:
        text = f"{others} of another export" if others else "none of any"
        raise RecordError(
            f"there must be two frames at least of {schema['prefix']} ({Path(layout).name}); there "
            f"{'is one' if frames else 'are none'}, and {text}"
        )
    words = np.frombuffer(b"".join(frames), "<u4").reshape(len(frames), -1)
    return _record(words, schema, len(bytes_) - used)


def _record(words: Any, schema: dict[str, Any], skipped: int) -> Record:
    """Return the frames on an even grid of samples."""
    count = np.concatenate([[0], np.cumsum(np.diff(words[:, 2]).astype("<u4").astype(np.int64))])
    if not (np.diff(count) > 0).all() or count[-1] > 100 * len(count) + 1000:
        raise RecordError("the frame counter jumps: the controller restarted during the recording")
    n = int(count[-1]) + 1

    def placed(values: Any) -> Any:
        result = np.full(n, np.nan)
        result[count] = values
        return result

    values = words[:, 4:-1].copy().view("<f4").astype(float)
    signals = {item["name"]: placed(values[:, k]) for k, item in enumerate(schema["numbers"])}
    units = {item["name"]: item["unit"] for item in schema["numbers"]}
    flags = words[:, 3]
    more = {"status": flags & 0xFFFF, "mode": flags >> 16 & 0xFF, "usable": flags >> 24 & 1}
    if not any(name.startswith("coil_0") for name in signals):
        del more["mode"]
    signals |= {name: placed(item) for name, item in more.items()}
    t = (int(words[0, 2]) + np.arange(n)) * schema["sampling_time"]
    meta = {"source": schema["prefix"], "missing": n - len(words), "skipped": skipped}
    return Record(t, signals, units | dict.fromkeys(more, "1"), meta)


def _layout(path: Path) -> dict[str, Any]:
    text = _bytes(path)
    try:
        schema: dict[str, Any] = json.loads(text)
        if not {"prefix", "layout", "sampling_time", "numbers"} <= set(schema):
            raise ValueError
    except (ValueError, TypeError) as error:
        raise RecordError(f"{path}: is not the telemetry.json of an export") from error
    return schema


def _bytes(path: Path) -> bytes:
    try:
        return memory_limit.read_bytes(path)
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror}") from error
