"""What fault isolation says of a record, and which faults of a machine it can tell apart."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ambkit.base.units import figure
from ambkit.judge.isolation.isolation import LIMIT, SEARCHES, LeastSizes, Searches
from ambkit.judge.isolation.signatures import Signature
from ambkit.result.report import Axis, Figure, Line, Panel, Rule
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put

FEW = 4  #: Curves of a picture.
LISTED = 6  #: Faults in the table of a terminal, besides those that are named or possible.
LEAST = 1.0  #: Likelihood ratio at its lower edge.
LAWS: dict[str, Callable[[float], float]] = {
    "mass": lambda s: s / (1 - s),
    "clock": lambda s: math.sqrt(max(1 + 2 * s, 0.0)) - 1,
}
"""Sizes by those of the signatures, which are shares of accelerations: 1 - m_0 / m, and half of
(T / T_0)^2 - 1."""
ROUGH = 2.0  #: Variance of slow innovations, over the stated one, that is remarked on.


@dataclass(frozen=True, repr=False)
class Diagnosis(Result):
    """Which faults explain the innovations of a filter along a record."""

    name: str  #: Of machine and filter.
    searches: Searches
    sampling_time: float
    remarks: Sequence[str] = field(default=())

    @cached_property
    def certain(self) -> bool:
        """Whether there is a fault; otherwise a disturbance force explains the record."""
        return bool(self.searches.alarms.any())

    @cached_property
    def decisive(self) -> int | None:
        """The search that names the first fault: the last one whose window has its beginning."""
        s = self.searches
        named = np.flatnonzero(s.alarms if self.certain else s.named.any(axis=1))
        if not named.size:
            return None
        later = named[named < named[0] + SEARCHES - 1]
        return int(later[-1])

    @property
    def faults(self) -> list[str]:
        """The faults; "a or b" where they cannot be distinguished; empty where none is certain."""
        return self._named if self.certain else []

    @property
    def _named(self) -> list[str]:
        groups = [] if self.decisive is None else self.searches.groups(self.decisive)
        return [" or ".join(group) for group in groups]

    @property
    def title(self) -> str:
        return f"{self.name}, {len(self.searches.t)} searches"

    @property
    def finding(self) -> str:
        k, stop = self.decisive, self._contact
        if k is None:
            return f"{self.title}: {stop or 'no fault'}."
        since = self._since(k, int(np.flatnonzero(self.searches.named[k])[0]))
        remark = "" if self.certain else "; a disturbance force explains it"
        remark += f"; {stop}" if stop else ""
        return f"{self.title}: {' and '.join(self._named)}, {since}{remark}."

    @property
    def _contact(self) -> str:
        """When the rotor is on a stop; empty where it never is."""
        s = self.searches
        first = np.flatnonzero(s.contact < s.window)[:1]
        ago = [float(s.t[k] - s.contact[k] * self.sampling_time) for k in first]
        return f"the rotor is on a stop at {figure(max(ago[0], 0.0), 's', 4)}" if ago else ""

    def _since(self, k: int, j: int) -> str:
        t = float(self.searches.t[k])
        start = t - float(self.searches.since[k, j]) * self.sampling_time
        before = "before" if self.searches.before[k, j] else "since"
        return f"{before} {figure(max(start, 0.0), 's', 4)}"

    @property
    def rows(self) -> list[Row]:
        k, s = self.decisive, self.searches
        ratios = s.likelihood.max(axis=0) if k is None else s.likelihood[k]
        result: list[Row] = []
        for place, j in enumerate(np.argsort(-ratios, kind="stable")):
            named = k is not None and bool(s.named[k, j] or s.instead[k, j] >= 0)
            rows = self._row(k, int(j), detail=place >= LISTED and not named)
            result += put(rows, section=("faults",), of=s.signatures[j].name)
        return result

    def _row(self, k: int | None, j: int, detail: bool) -> list[Row]:
        s, signature = self.searches, self.searches.signatures[j]
        at = int(np.argmax(s.likelihood[:, j])) if k is None else k
        size = float(np.linalg.norm(s.size[at, j])) if len(signature.columns) > 1 else None
        size = float(s.size[at, j, 0]) if size is None else size
        error = float(s.std[at, j].max())
        law = LAWS.get(signature.name, float)
        size, error = law(size), abs(law(size + error) - law(size - error)) / 2
        raised = k is not None and s.likelihood[at, j] >= LIMIT
        group = int(s.instead[at, j])  # of faults that cannot be told apart
        shared = group >= 0 and np.count_nonzero(s.instead[at] == group) > 1
        verdict = "possible" if shared else "named" if group >= 0 else "–"
        rows = [
            Row("likelihood", "likelihood ratio", float(s.likelihood[at, j]), digits=3),
            Row("size", "size", size if raised else None, signature.unit, 3,
                error=error if raised else None),
            Row("since", "begin", self._since(at, j) if raised else None),
            Row("verdict", "verdict", None if k is None else verdict),
            Row("about", "what is off", signature.about),
        ]  # fmt: skip
        return [replace(row, detail=detail) for row in rows]

    SECTIONS = {("faults",): Section("Faults", across=True)}

    @property
    def notes(self) -> Sequence[str]:
        left = len({row.of for row in self.rows if row.detail})
        rest = [f"{left} further faults are less likely"] * (left > 0)
        return [*self.remarks, *self._rough, *rest]

    @property
    def _rough(self) -> list[str]:
        """The remark that the load is rougher than the filter assumes."""
        s, k = self.searches, self.decisive
        rough = float(s.roughness[slice(k, None if k is None else k + 1)].max(initial=0.0))
        return [
            f"the disturbance force is about {rough:.2g} times as intense as the filter assumes, "
            "by its slow innovations: likelihood ratios are divided by that; tune process noise"
        ] * (rough > ROUGH)

    @property
    def series(self) -> dict[str, Any]:
        return {
            "named": self.faults, "limit": LIMIT, "t": self.searches.t.tolist(),
            "likelihood": {
                s.name: self.searches.likelihood[:, j].tolist()
                for j, s in enumerate(self.searches.signatures)
            },
        }  # fmt: skip

    def figures(self) -> list[Figure]:
        s = self.searches
        order = np.argsort(-s.likelihood.max(axis=0), kind="stable")[:FEW]
        lines = [
            Line(s.t, np.maximum(s.likelihood[:, j], LEAST), signal=f"series {place}",
                 label=s.signatures[j].name)
            for place, j in enumerate(order, 1)
        ]  # fmt: skip
        top = 2 * max(LIMIT, float(s.likelihood.max(initial=0.0)))
        panel = Panel(
            Axis("time", "s"), Axis("likelihood ratio", scale="log", limits=(LEAST, top)),
            [*lines, Rule(LIMIT, signal="limit", label="alarm")],
        )  # fmt: skip
        return [
            Figure(
                id="diagnosis",
                title=f"{self.name}: faults",
                caption="Twice the logarithm of the likelihood ratio of each fault to no fault, "
                "for the last innovations.",
                panels=[panel],
            )
        ]


@dataclass(frozen=True, repr=False)
class Distinction(Result):
    """Which faults of a machine can be distinguished, and from which size on."""

    name: str  #: Of machine and filter.
    signatures: tuple[Signature, ...]
    operations: dict[str, LeastSizes]  #: By what the machine does.
    window: float  #: [s]

    @property
    def title(self) -> str:
        return f"{self.name}, within {figure(self.window, 's', 3)}"

    @property
    def finding(self) -> str:
        of = [
            f"{sum(self._can(sizes))} of {len(self.signatures)} {operation}"
            for operation, sizes in self.operations.items()
        ]
        return f"{self.title}: faults that can be named: {', '.join(of)}."

    def _can(self, sizes: LeastSizes) -> list[bool]:
        return [
            bool(least <= signature.most)
            for least, signature in zip(sizes.named, self.signatures, strict=True)
        ]

    @property
    def rows(self) -> list[Row]:
        result: list[Row] = []
        for operation, sizes in self.operations.items():
            for j, signature in enumerate(self.signatures):
                rows = self._row(sizes, j, signature)
                result += put(rows, section=(operation,), of=signature.name)
        return result

    @property
    def table(self) -> dict[str, Any]:
        """The same as texts: a row of each fault."""
        return {
            "window": figure(self.window, "s", 3),
            "operations": list(self.operations),
            "rows": [
                [signature.name, *(row.text() for row in self.rows
                                   if row.of == signature.name and row.key != "about")]
                for signature in self.signatures
            ],
        }  # fmt: skip

    def _row(self, sizes: LeastSizes, j: int, signature: Signature) -> list[Row]:
        alarm, named = float(sizes.detected[j]), float(sizes.named[j])
        alike = [
            other.name
            for k, other in enumerate(self.signatures)
            if k != j and not sizes.apart[j, k] <= signature.most
        ]
        seen = alarm <= signature.most
        like = None if not seen else ", ".join(alike) or "none"
        unit = "%" if signature.unit == "1" else signature.unit
        return [
            Row("alarm", "alarm from", alarm if seen else None, unit, 2),
            Row("named", "named from", named if named <= signature.most else None,
                unit, 2),
            Row("alike", "confused with", like),
            Row("about", "what is off", signature.about, detail=True),
        ]  # fmt: skip

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        return {
            (operation,): Section(f"Least sizes {operation}", across=True)
            for operation in self.operations
        }

    @property
    def series(self) -> dict[str, Any]:
        return {"window": self.window}

    def figures(self) -> list[Figure]:
        return []
