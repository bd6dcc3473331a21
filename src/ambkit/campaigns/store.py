"""Folder of a campaign: its study, and its rows in parts that are written atomically.

::

    out/campaign.json        what the rows follow from: study, version, columns
    out/study.toml           the study, to be resumed and replayed from
    out/runs/part-000000.parquet
    out/traces/part-000000.parquet

A part is written under a temporary name and then renamed, so that an interrupted campaign leaves
complete parts only. Readers of Parquet ignore names that begin with a dot.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base import files
from ambkit.base.errors import AmbkitError, library
from ambkit.base.escaping import json_text
from ambkit.campaigns.plan import Plan
from ambkit.campaigns.study import Study
from ambkit.campaigns.worker import Rows, schema, versions

if TYPE_CHECKING:
    import pyarrow as pa

RUNS, TRACES, ABOUT, STUDY, LOCK = "runs", "traces", "campaign.json", "study.toml", ".lock"

_PART = re.compile(r"part-(\d{6,})\.parquet")


class Folder:
    """A campaign's folder."""

    def __init__(self, path: str | os.PathLike[str], plan: Plan) -> None:
        library("pyarrow", f"{os.fspath(path)}: a campaign's folder", "campaign")
        self.path, self.plan = Path(path), plan

    @classmethod
    def existing(cls, path: str | os.PathLike[str]) -> Folder:
        """Return the folder of a campaign that has begun."""
        path = Path(path)
        if not (path / ABOUT).is_file():
            raise AmbkitError(f"{path}: there is no campaign in it: it has no {ABOUT}")
        result = cls(path, Plan(Study.load(path / STUDY)))
        result._check(result._about())
        return result

    def begin(self) -> None:
        """Create the folder, or verify that it belongs to this study and version."""
        files.make_folder(self.path)
        if (self.path / ABOUT).is_file():
            self._check(self._about())
        else:
            there = sorted(item.name for item in self.path.iterdir() if item.name != LOCK)
            if there:
                raise AmbkitError(
                    f"{self.path}: holds {there[0]} and no campaign; give a folder of its own"
                )
            for name in (RUNS, TRACES) if self.plan.study.record.traces else (RUNS,):
                files.make_folder(self.path / name)
            self.plan.described.save(self.path / STUDY)
            # Last: a folder with this file is complete.
            files.write_text(self.path / ABOUT, json_text(self._is_of(), indent=2) + "\n")
        if not os.access(self.path / RUNS, os.W_OK):
            raise AmbkitError(f"{self.path / RUNS}: cannot be written")
        for name in (RUNS, TRACES):  # incomplete files of a campaign that was killed
            for left in (self.path / name).glob(".*.tmp"):
                with suppress(OSError):
                    left.unlink()

    def _is_of(self) -> dict[str, Any]:
        plan = self.plan
        return {
            "campaign": plan.study.name,
            "ambkit": versions()["ambkit"],
            "study": plan.fingerprint,
            "runs": plan.runs,
            "part": plan.study.part,
            "columns": {
                field.name: (field.metadata or {}).get(b"unit", b"").decode()
                for field in schema(plan)
            },
        }

    def _about(self) -> dict[str, Any]:
        try:
            result = json.loads(files.read_text(self.path / ABOUT))
        except ValueError as error:
            raise AmbkitError(f"{self.path / ABOUT}: is no JSON: {error}") from None
        if not isinstance(result, dict):
            raise AmbkitError(f"{self.path / ABOUT}: is not of a campaign")
        return result

    def _check(self, there: dict[str, Any]) -> None:
        here = self._is_of()
        if there.get("ambkit") != here["ambkit"]:
            raise AmbkitError(
                f"{self.path}: was started by ambkit {there.get('ambkit')}, this is "
                f"{here['ambkit']}: its runs would be mixed; give another folder"
            )
        if there.get("study") != here["study"]:
            raise AmbkitError(
                f"{self.path}: belongs to another study: what varies, the bearing or the run  "
                "has changed since its start; give another folder"
            )

    @contextmanager
    def held(self) -> Iterator[None]:
        """Lock the folder; the lock of a killed process is released."""
        try:
            import fcntl
        except ImportError:  # Windows
            yield
            return
        files.make_folder(self.path)
        try:
            lock = os.open(self.path / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise AmbkitError(f"{self.path}: cannot be written: {error.strerror}") from None
        try:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise AmbkitError(f"{self.path}: another campaign is running in it") from None
            except OSError:  # a file system without locks
                pass
            yield
        finally:
            os.close(lock)

    def done(self) -> set[int]:
        """Return which parts exist."""
        results = set()
        with suppress(FileNotFoundError, NotADirectoryError):
            for item in os.scandir(self.path / RUNS):
                if match := _PART.fullmatch(item.name):
                    results.add(int(match[1]))
        return results

    def write(self, part: int, rows: Rows) -> None:
        """Move a part into place, its traces before its rows."""
        from pyarrow import parquet

        for name, table in ((TRACES, rows.traces), (RUNS, rows.runs)):
            if table is not None:
                made_of = {"study": self.plan.study.name, "study_hash": self.plan.fingerprint,
                           "seed": str(self.plan.study.seed), "part": str(part)}  # fmt: skip
                table = table.replace_schema_metadata(made_of | versions())
                with (
                    files.replacing(self.file(part, name)) as temporary,
                    open(temporary, "wb") as file,
                ):
                    parquet.write_table(table, file)
                    file.flush()
                    os.fsync(file.fileno())  # before its name marks it as complete

    def file(self, part: int, name: str = RUNS) -> Path:
        """Return the path of a part."""
        return self.path / name / f"part-{part:06d}.parquet"

    def column(self, part: int, name: str) -> Any:
        """Return a column of a part as an array."""
        return array_of(self.table(part, [name]).column(0))

    def table(self, part: int, columns: list[str] | None = None) -> pa.Table:
        """Return a part, or some columns of it."""
        import pyarrow as pa
        from pyarrow import parquet

        path = self.file(part)
        try:
            with parquet.ParquetFile(path) as file:  # a dataset would import pandas
                result = file.read(columns)
        except (OSError, pa.ArrowException) as error:
            message = str(error).partition("\n")[0]
            raise AmbkitError(
                f"{path}: is damaged, delete it to have it computed again: {message}"
            ) from None
        first, stop = self.plan.span(part)
        if result.num_rows != stop - first:
            raise AmbkitError(
                f"{path}: has {result.num_rows} rows and should have {stop - first}; delete it to "
                "have it computed again"
            )
        return result


def array_of(column: pa.ChunkedArray) -> Any:
    """Return a column as an array (n,); repeated texts are stored once."""
    import pyarrow as pa

    if not pa.types.is_string(column.type):
        return column.to_numpy(zero_copy_only=False)
    encoded = column.combine_chunks().dictionary_encode()
    words = np.array(encoded.dictionary.to_pylist() or [""], dtype=object)
    return words[encoded.indices.to_numpy(zero_copy_only=False)]
