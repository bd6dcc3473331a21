"""The expert system: a fuzzy basis function network for k_i and k_s (paper, eq. 32-33).

A rule states k_i and k_s for currents and displacements near its centre. The mathematics is in C
(``ambkit/fuzzy.h``); this module has the description of a network, and its file.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, ValidationError

from ambkit._core import MAX_RULES, Fuzzy
from ambkit.base import files
from ambkit.base.arrays import Array, check_finite, real
from ambkit.base.config import Part, Read
from ambkit.base.config.problems import Problem, dotted
from ambkit.base.config.quantities import Description, Line
from ambkit.base.config.toml_text import line_of
from ambkit.base.errors import AmbkitError, ConfigError
from ambkit.base.escaping import one_line
from ambkit.fuzzy.network import Scaling, default_width, network, scale_factors
from ambkit.machine import paper
from ambkit.machine.magnets import evaluate_force, evaluate_stiffness
from ambkit.machine.stiffness import StiffnessMap
from ambkit.result.card import Card
from ambkit.result.showing import Shown

Method = Literal["least-squares", "steepest-gradient"]

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
# 1 / (2 sigma^2) must be finite in single precision too.
_Width = Annotated[float, Field(ge=1e-9, le=1e9)]


class Rule(Part):
    """A rule: a row of the paper's Table 6, with its entries of Tables 4 and 5."""

    current: _Finite
    """Centre in the control current [A] (tau of eq. 32)."""
    displacement: _Finite
    """Centre in the displacement [m]."""
    width_k_i: _Width
    """Width of its Gaussian for k_i, in scaled units (sigma of eq. 32)."""
    width_k_s: _Width
    """Width of its Gaussian for k_s, in scaled units."""
    weight_k_i: _Finite
    """Its conclusion for k_i [N/A] (w of eq. 33)."""
    weight_k_s: _Finite
    """Its conclusion for k_s [N/m]."""


class Training(Part):
    """Training of a network: method and learning curves (paper, Fig. 10)."""

    # The curves are RMS errors over the training samples, starting with the untrained network.

    method: Method
    """Method of the training."""
    weights: bool
    """Whether the weights were trained too."""
    force_rms: tuple[_Finite, ...]
    """Learning curve of the force [N]."""
    k_i_rms: tuple[_Finite, ...]
    """Learning curve of k_i [N/A]."""
    k_s_rms: tuple[_Finite, ...]
    """Learning curve of k_s [N/m]."""


class Expert(Shown, Part):
    """A fuzzy basis function network for k_i and k_s at (iu, x).

    Two inputs, scaled to comparable distances; Gaussian rules; two outputs, whose rules share their
    centres and have separate widths and weights. Outside its box the network is evaluated at the
    nearest point of the box.
    """

    format: Literal["ambkit expert"] = "ambkit expert"
    """Type of the file."""
    version: int = 1
    """Version of the file format."""
    source: Description
    """Machine or map that the network describes."""
    source_hash: Line = ""
    """Fingerprint of its stiffness map."""
    normalised: bool = True
    """Whether the memberships are divided by their sum (Wang and Mendel 1992), so that an output is
    a weighted mean of the rules' conclusions. False: eq. 33 as printed.
    """
    per_ampere: _Positive
    """Scale of the current [1/A]."""
    per_metre: _Positive
    """Scale of the displacement [1/m]."""
    current_range: tuple[_Finite, _Finite]
    """Range of the control current [A]."""
    displacement_range: tuple[_Finite, _Finite]
    """Range of the displacement [m]."""
    force_bias: _Finite = 0.0
    """Force at iu = 0, x = 0 [N]: zero for a two-sided magnet."""
    rules: Annotated[tuple[Rule, ...], Field(max_length=MAX_RULES)]
    """The rules in the order of the paper's Table 6: the current varies first."""
    training: Training | None = None
    """Training; None if untrained."""

    def __repr__(self) -> str:
        return f"<Expert of {len(self.rules)} rules for {one_line(self.source)}>"

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if read("version") != 1:
            yield "version", f"must be 1, the layout that this ambkit reads; is {read('version')}"
        if read("rules") == ():
            yield "rules", "must be one or more, is an empty list"
        for name, unit in (("current_range", "A"), ("displacement_range", "m")):
            ends = read(name)
            if isinstance(ends, tuple) and not ends[0] < ends[1]:
                yield name, f"must ascend, is {ends[0]:g} {unit} to {ends[1]:g} {unit}"

    @classmethod
    def from_map(
        cls,
        stiff: StiffnessMap,
        *,
        widths: ArrayLike | None = None,
        weights: ArrayLike | None = None,
        normalised: bool = True,
        scaling: Scaling = "grid",
        training: Training | None = None,
    ) -> Self:
        """Build a network with one rule at each node of a stiffness map.

        Parameters
        ----------
        stiff : StiffnessMap
            Provides centres, box and, by default, the weights.
        widths : array_like, optional
            Widths in scaled units, with a shape that broadcasts to (2, rules): for k_i, for k_s.
            Default: half of the larger node step, 0.375 on the paper's grid with its scaling (the
            paper starts with 0.4).
        weights : array_like (2, rules), optional
            k_i [N/A] and k_s [N/m] of the rules. Default: those of the map.
        normalised : bool
            Divide by the sum of the memberships; False is eq. 33 as printed.
        scaling : {"grid", "unit"} or tuple of 2 floats
            Scaling of the inputs. ``"grid"``: by the node steps of current and displacement.
            ``"unit"``: one ampere equals one millimetre, as in the paper. Or the scale factors,
            (1/A, 1/m).
        training : Training, optional
            Training of widths and weights.

        Raises
        ------
        AmbkitError
            Too many nodes, a width or scale factor that is not positive, or shapes that do not
            match.
        """
        scale = scale_factors(stiff, scaling)
        shape = (2, stiff.k_i.size)
        widths = default_width(stiff, scale) if widths is None else widths
        weights = [stiff.k_i.ravel(), stiff.k_s.ravel()] if weights is None else weights
        return cls._of(
            source=stiff.name,
            source_hash=stiff.fingerprint,
            normalised=normalised,
            scale=scale,
            nodes=(stiff.current, stiff.displacement),
            force_bias=stiff.force_bias,
            widths=_shaped("widths", widths, shape),
            weights=_shaped("weights", weights, shape),
            training=training,
        )

    @classmethod
    def paper(cls, *, normalised: bool = False) -> Self:
        """Build the paper's network: widths of Table 6, weights of Tables 4 and 5, as printed.

        Parameters
        ----------
        normalised : bool
            False: eq. 33 as printed. True: with the memberships divided by their sum.
        """
        return cls._of(
            source="Tables 4, 5 and 6 of the paper",
            normalised=normalised,
            scale=(1.0, 1e3),
            nodes=(np.array(paper.CURRENTS), np.array(paper.DISPLACEMENTS)),
            widths=paper.table6(),
            weights=np.stack([paper.table4().ravel(), paper.table5().ravel()]),
        )

    @classmethod
    def _of(
        cls,
        *,
        scale: tuple[float, float],
        nodes: tuple[Array, Array],
        widths: Array,
        weights: Array,
        **fields: Any,
    ) -> Self:
        """Build a network with its rules on a grid; widths and weights (2, rules)."""
        (per_ampere, per_metre), (current, displacement) = scale, nodes
        iu, x = np.meshgrid(current, displacement)
        table = np.column_stack([iu.ravel(), x.ravel(), *widths, *weights]).tolist()
        return cls(
            per_ampere=per_ampere,
            per_metre=per_metre,
            current_range=(current[0], current[-1]),
            displacement_range=(displacement[0], displacement[-1]),
            rules=tuple(Rule(**dict(zip(Rule.model_fields, row, strict=True))) for row in table),
            **fields,
        )

    def scaled(self, factor: float) -> Self:
        """Return the expert of a magnet with a scaled constant.

        The magnet constant is a factor of the force, and therefore of k_i and k_s: the rules keep
        their centres and widths, and only their conclusions are scaled. Training for the other
        constant has the same result, except for the end of its search.

        Parameters
        ----------
        factor : float
            The other magnet constant relative to this one, positive.

        Raises
        ------
        AmbkitError
            The factor is not positive and finite.
        """
        if not 0 < factor < float("inf"):
            raise AmbkitError(f"factor must be greater than 0 and finite, is {factor!r}")

        changed: dict[str, Any] = {
            "source": f"{self.source}, magnet constant times {factor:g}",
            "source_hash": "",  # it is that of the other map
            "force_bias": factor * self.force_bias,
            "rules": tuple(_times(r, factor, "weight_k_i", "weight_k_s") for r in self.rules),
        }
        if self.training is not None:
            changed["training"] = _times(self.training, factor, "force_rms", "k_i_rms", "k_s_rms")
        return self.model_copy(update=changed)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a network written by `save`, with the same bits.

        Parameters
        ----------
        path : path
            The file.

        Raises
        ------
        AmbkitError
            The file cannot be read, is not JSON, or not such a network; the message states each
            place.
        """
        name = os.fspath(path)
        try:
            text = files.read_text(path)
            return cls.model_validate(json.loads(text))
        except json.JSONDecodeError as error:
            raise AmbkitError(
                f"{name}:{error.lineno}: not valid JSON: {error.msg}; "
                "an expert from 'ambkit train' is expected"
            ) from None
        except RecursionError:
            raise AmbkitError(f"{name}: is nested too deeply for an expert") from None
        except ValidationError as error:
            results = [
                (f"{name}:{line_of(text, p.path)}", dotted(p.path), p.text)
                for p in Problem.unpack(error)
            ]
            raise ConfigError([": ".join(filter(None, parts)) for parts in results], name) from None
        except ValueError:  # raised by int() for too many digits
            digits = f"more than {sys.get_int_max_str_digits()} digits"
            raise AmbkitError(f"{name}: has an integer of {digits}") from None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the network as JSON, one line per rule, through a temporary file.

        Parameters
        ----------
        path : path
            The file.

        Raises
        ------
        AmbkitError
            The file cannot be written; an existing one is unchanged.
        """
        fields = {key: json.dumps(value) for key, value in self.model_dump().items()}
        rules = ",\n    ".join(json.dumps(rule.model_dump()) for rule in self.rules)
        fields["rules"] = f"[\n    {rules}\n  ]"
        lines = ",\n  ".join(f'"{key}": {value}' for key, value in fields.items())
        files.write_text(path, f"{{\n  {lines}\n}}\n")

    @property
    def widths(self) -> Array:
        """Widths of the rules (2, rules) in scaled units: for k_i, for k_s."""
        return np.array([(r.width_k_i, r.width_k_s) for r in self.rules]).T

    @property
    def weights(self) -> Array:
        """Conclusions of the rules (2, rules): k_i [N/A], k_s [N/m]."""
        return np.array([(r.weight_k_i, r.weight_k_s) for r in self.rules]).T

    @property
    def centres(self) -> Array:
        """Centres of the rules (2, rules): current [A], displacement [m]."""
        return np.array([(r.current, r.displacement) for r in self.rules]).T

    @property
    def learning_curve(self) -> Array:
        """Force RMS over the training samples (steps + 1,) [N], untrained first (Fig. 10)."""
        return np.array(self.training.force_rms if self.training else ())

    def in_core(self, core: ModuleType) -> Fuzzy:
        """Build the C implementation.

        Parameters
        ----------
        core : module
            Build of the core, see `ambkit.machine.magnets.core_module`.
        """
        return network(core, self, self.widths, self.weights)

    def stiffness(self, iu: ArrayLike, x: ArrayLike) -> tuple[Array, Array]:
        """k_i [N/A] and k_s [N/m], with ``F - F(0, 0) = k_i iu + k_s x`` (eq. 26, 32, 33).

        Parameters
        ----------
        iu, x : array_like
            Control current [A] and displacement [m], with shapes that broadcast. Outside the box
            the nearest point of the box is used.

        Raises
        ------
        AmbkitError
            A current or displacement is not finite.
        """
        check_finite(iu=iu, x=x)
        k_i, k_s = evaluate_stiffness(self, iu, x)
        return k_i, k_s

    def force(self, iu: ArrayLike, x: ArrayLike) -> Array:
        """Magnet force ``k_i iu + k_s x + F(0, 0)`` [N]; see `stiffness`.

        Parameters
        ----------
        iu, x : array_like
            Control current [A] and displacement [m], with shapes that broadcast.

        Raises
        ------
        AmbkitError
            A current or displacement is not finite.
        """
        check_finite(iu=iu, x=x)
        return evaluate_force(self, iu, x) + self.force_bias

    def _card(self) -> Card:
        from ambkit.fuzzy.expert_card import expert_card

        return expert_card(self)


def _times(part: Any, factor: float, *names: str) -> Any:
    """Return a part with some of its numbers multiplied."""
    values = {name: getattr(part, name) for name in names}
    return part.model_copy(update={
        name: tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value
        for name, value in values.items()
    })  # fmt: skip


def _shaped(name: str, values: ArrayLike, shape: tuple[int, int]) -> Array:
    array = real(name, values)
    try:
        return np.broadcast_to(array, shape)
    except ValueError:
        raise AmbkitError(
            f"{name} must have shape {shape}, an output a row and a rule a column, or one that "
            f"broadcasts to it; has {array.shape}"
        ) from None
