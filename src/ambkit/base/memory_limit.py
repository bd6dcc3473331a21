"""Memory limit for reading a file, from its declared sizes: a small one can unpack to more."""

import os
import stat

from ambkit.base.errors import AmbkitError, RecordError
from ambkit.base.units import parse

LIMIT = 8e9  #: Default memory limit for reading one file [byte].
VARIABLE = "AMBKIT_READ_MEMORY"  #: Environment variable with another limit, such as ``16 GB``.
#: Memory to read a CSV, over the size of the file, measured with 9 digits per number.
TEXT_SHARE = 7
STREAM_SHARE = 100  #: Minimum for a pipe or a device, which may never end.
_LEAST = 1 << 20


def limit() -> float:
    """Return the memory limit for reading one file [byte]."""
    limit_text = os.environ.get(VARIABLE, "")
    if not limit_text:
        return LIMIT
    try:
        size = parse(limit_text, "byte")
    except ValueError as error:
        raise AmbkitError(f"{VARIABLE}: {error}; write it like 16 GB") from None
    if not size > 0:
        raise AmbkitError(f"{VARIABLE}: must be greater than 0 GB, is {limit_text}")
    return size


def check(path: str | os.PathLike[str], size: float, hint: str = "", *, exact: bool = True) -> None:
    """Reject a file that needs more memory than the limit."""
    allowed = limit()
    if size > allowed:
        needed = _shown(size) if exact else f"more than {_shown(allowed)}"
        enough = 1.1 * size if exact else 2 * allowed
        raise RecordError(
            f"{path}: would take {needed} of memory to read, and the limit is {_shown(allowed)};"
            f'{hint} to allow more, set {VARIABLE}, such as {VARIABLE}="{_shown(enough)}"'
        )


def read_bytes(path: str | os.PathLike[str], share: float = 1.0) -> bytes:
    """Read a complete file, with `share` bytes of memory per byte."""
    with open(path, "rb") as file:
        status = os.fstat(file.fileno())
        check(path, share * status.st_size)
        stream = not stat.S_ISREG(status.st_mode)
        most = limit() / max(share, STREAM_SHARE if stream else 0)
        content = bytearray()
        while part := file.read(max(status.st_size + 1, _LEAST)):
            content += part
            if stream and len(content) > most:
                raise RecordError(
                    f"{path}: is a pipe or a device that does not end within {_shown(most)}; save "
                    "what it gives in a file"
                )
            check(path, share * len(content), exact=False)
    return bytes(content)


def _shown(size: float) -> str:
    return f"{size / 1e9:.3g} GB" if size >= 1e8 else f"{size / 1e6:.3g} MB"
