"""Random models, and a model's steps as naive loops in the order that the core's kernel keeps."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.models import MATRICES, NUMBER, ONE, ZERO, Descriptor, Model
from ambkit.models.model import compressed_rows

Array = NDArray[np.float64]


class Settings(NamedTuple):
    """What a step is given beside the model."""

    k_i: Array  # (p,) [N/A]
    k_s: Array  # (p,) [N/m]
    k_ui: Array  # (c,) [A/V]
    var_u: Array  # (c,) [V^2]
    var_noise: Array  # (k,)
    var_y: Array  # (m,) [m^2]


def random_model(seed: int, n: int, p: int, m: int, *, controlled: bool | None = None) -> Model:
    """Return a model of a random sparse pattern: stable, and all its numbers about 1.

    Its spectral radius stays below 1 with `random_settings` of any seed, forces closed. About half
    of the patterns have states that the controls reach past the forces; `controlled` decides.

    Parameters
    ----------
    seed : int
        Of pattern and numbers.
    n, p, m : int
        States, forces (and as many controls) and measurements; n >= 2.
    controlled : bool, optional
        Whether ``B_u`` has entries.
    """
    rng = np.random.default_rng([seed, n, p, m])
    k = int(rng.integers(1, 4))
    sizes = {"states": n, "forces": p, "controls": p, "measurements": m, "noises": k}
    kinds = {name: np.zeros([sizes[of] for of in MATRICES[name]], int) for name in MATRICES}
    density = min(0.5, 3 / n)

    def fill(name: str, share: float, ones: float) -> None:
        some = rng.random(kinds[name].shape)
        kinds[name][some < share] = NUMBER
        kinds[name][some < share * ones] = ONE

    fill("L", density, 0.0)
    fill("b", max(density, 0.2), 0.0)
    fill("e", density / 2, 0.3)
    fill("c", 0.7 / n, 0.5)
    fill("r", 0.7 / n, 0.8)
    kinds["L"][np.diag_indices(n)] = rng.choice([NUMBER, NUMBER, NUMBER, ZERO], n)
    for f in range(p):
        kinds["h"][f, rng.integers(n)] = ONE
        kinds["h"][f, rng.integers(n)] = NUMBER
        kinds["d"][f, rng.integers(p)] = rng.choice([ONE, NUMBER])
        kinds["d"][f, f] = rng.choice([ONE, NUMBER, ZERO])
        kinds["b"][rng.integers(n), f] = NUMBER
    for r in range(m):
        kinds["c"][r, rng.integers(n)] = ONE
    if controlled if controlled is not None else rng.random() < 0.5:
        fill("B_u", density / 2, 0.5)
        kinds["B_u"][rng.integers(n), 0] = ONE
    kinds["rest"][np.diag_indices(n)] = ONE
    values = {
        name: np.where(kind == NUMBER, rng.uniform(-1, 1, kind.shape), kind == ONE)
        for name, kind in kinds.items()
    }
    for source in range(k):
        root = np.where(rng.random((n, 2)) < density, rng.uniform(-0.1, 0.1, (n, 2)), 0)
        root[rng.integers(n), 0] = 0.1
        values["N"][source] = root @ root.T
        seen = root != 0
        kinds["N"][source][(seen[:, None] & seen[None]).any(2)] = NUMBER
    # The first source drives every state, so that the covariance stays positive definite.
    values["N"][0] += np.diag(rng.uniform(1e-3, 1e-2, n))
    kinds["N"][0][np.diag_indices(n)] = NUMBER
    # A norm of at most 0.95 in L and the forces together, at the greatest stiffnesses.
    row = 2.0 * (np.abs(values["h"]) + np.abs(values["e"])) + np.abs(values["r"])
    reach = (np.abs(values["L"]) + np.abs(values["b"]) @ row).sum(1, keepdims=True)
    scale = 0.95 / np.maximum(reach, 0.95)
    values["L"], values["b"] = values["L"] * scale, values["b"] * scale
    # Some states are what an earlier one was a sample before, as past controls are.
    for i in np.flatnonzero(rng.random(n - 1) < 0.2) + 1:
        for name in ("L", "b"):
            kinds[name][i], values[name][i] = ZERO, 0.0
        earlier = rng.integers(i)
        kinds["L"][i, earlier], values["L"][i, earlier] = ONE, 1.0
    names = {
        "states": "X", "forces": "f", "controls": "u", "measurements": "y", "noises": "w",
    }  # fmt: skip
    descriptors: dict[str, Any] = {
        of: tuple(Descriptor(f"{names[of]}{i}", "1", 1.0, "noise") for i in range(count))
        for of, count in sizes.items()
    }
    pattern = {name: kind.astype(np.int8) for name, kind in kinds.items()}
    return Model(name="random", T=1e-3, pattern=pattern, **descriptors, **values)


def random_settings(model: Model, seed: int) -> Settings:
    """Return stiffnesses of at most 2, and variances."""
    rng = np.random.default_rng(seed)
    p, c, m, k = (
        len(getattr(model, of)) for of in ("forces", "controls", "measurements", "noises")
    )
    return Settings(
        k_i=rng.uniform(-2, 2, p), k_s=rng.uniform(-2, 2, p), k_ui=rng.uniform(0.5, 2, c),
        var_u=rng.uniform(0.01, 1, c), var_noise=rng.uniform(0.01, 1, k),
        var_y=rng.uniform(0.01, 1, m),
    )  # fmt: skip


def random_state(model: Model, seed: int) -> tuple[Array, Array]:
    """Return a mean (n,) and a positive covariance (n, n)."""
    rng, n = np.random.default_rng(seed), len(model.states)
    root = rng.uniform(-1, 1, (n, n)) / np.sqrt(n)
    return rng.uniform(-1, 1, n), root @ root.T + 0.1 * np.eye(n)


# ---- the steps, entry by entry ----


def added(terms: Iterable[float]) -> float:
    """Sum in the order given; Python's own sum compensates."""
    total = 0.0
    for term in terms:
        total = total + term
    return total


class Loops:
    """Steps of a model as loops over structural entries: the order of sums is the contract.

    A structural one takes part as a factor of 1.0, which changes no bit.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.n, self.p, self.c = len(model.states), len(model.forces), len(model.controls)
        self.rows = {name: self.entries(name) for name in MATRICES if name != "N"}

    def entries(self, name: str) -> list[list[tuple[int, float]]]:
        """Column and value of each row's entries, columns ascending."""
        start, column, value = compressed_rows(
            getattr(self.model, name), self.model.pattern[name] != ZERO
        )
        return [
            [(column[at], value[at]) for at in range(start[i], start[i + 1])]
            for i in range(len(start) - 1)
        ]

    def growth(self, var_noise: Array) -> Array:
        """What the sources leave (n, n)."""
        G = np.zeros((self.n, self.n))
        for i in range(self.n):
            for j in range(self.n):
                G[i, j] = added(
                    float(self.model.N[k, i, j]) * float(var)
                    for k, var in enumerate(var_noise)
                    if self.model.pattern["N"][k, i, j] != ZERO
                )
        return G

    def displacement(self, X: Array) -> Array:
        return np.array([added(a * float(X[j]) for j, a in row) for row in self.rows["h"]])

    def current(self, X: Array, u: Array) -> Array:
        return np.array([
            added([*(a * float(X[j]) for j, a in e), *(a * float(u[j]) for j, a in d)])
            for e, d in zip(self.rows["e"], self.rows["d"], strict=True)
        ])  # fmt: skip

    def predict_mean(self, X: Array, F: Array, u: Array) -> Array:
        """F: forces without what is collocated with them."""
        whole = [
            added([float(F[f]), *(a * float(X[j]) for j, a in row)])
            for f, row in enumerate(self.rows["r"])
        ]
        return np.array([
            added([
                *(a * float(X[j]) for j, a in self.rows["L"][i]),
                *(a * float(u[j]) for j, a in self.rows["B_u"][i]),
                *(a * whole[f] for f, a in self.rows["b"][i]),
            ])
            for i in range(self.n)
        ])  # fmt: skip

    def predict_covariance(self, P: Array, s: Settings, G: Array) -> Array:
        """P, G (n, n): their upper triangles are read, the whole is returned."""
        n, p, c = range(self.n), range(self.p), range(self.c)
        P = np.triu(P) + np.triu(P, 1).T
        var = [float(v) for v in s.var_u]
        row: list[list[tuple[int, float]]] = []
        for f in p:
            h, e, r = (dict(self.rows[name][f]) for name in "her")
            row.append([])
            for j in sorted({*h, *e, *r}):
                terms = [float(s.k_s[f]) * h[j]] if j in h else []
                terms += [float(s.k_i[f]) * e[j]] if j in e else []
                terms += [r[j]] if j in r else []
                row[f].append((j, added(terms)))
        g = [[0.0] * self.c for _ in p]
        for f in p:
            for at, d in self.rows["d"][f]:
                g[f][at] = (float(s.k_i[f]) * d) * float(s.k_ui[at])
        q = [[added((g[a][at] * g[f][at]) * var[at] for at in c) for f in p] for a in p]
        w = [[added(float(P[k, j]) * a for k, a in row[f][::-1]) for j in n] for f in p]
        L, b = self.rows["L"], self.rows["b"]
        M = [
            [
                added([*(a * float(P[k, j]) for k, a in L[i]), *(a * w[f][j] for f, a in b[i])])
                for j in n
            ]
            for i in n
        ]
        B = [{at: a * float(s.k_ui[at]) for at, a in self.rows["B_u"][i]} for i in n]
        z = [
            [
                added([
                    *(a * q[k][f] for k, a in b[i]),
                    *((a * var[at]) * g[f][at] for at, a in B[i].items()),
                    *(a * M[i][k] for k, a in row[f][::-1]),
                ])
                for f in p
            ]
            for i in n
        ]  # fmt: skip
        U = [
            [added([B[i].get(at, 0.0), *(a * g[f][at] for f, a in b[i])]) * var[at] for at in c]
            for i in n
        ]
        new = np.zeros_like(P)
        for i in n:
            for j in range(i, self.n):
                new[i, j] = new[j, i] = added([
                    *(a * M[i][k] for k, a in L[j]),
                    float(G[i, j]),
                    *(a * U[i][at] for at, a in B[j].items()),
                    *(a * z[i][f] for f, a in b[j]),
                ])  # fmt: skip
        return new

    def update(
        self, r: int, y: float, var_y: float, X: Array, P: Array
    ) -> tuple[Array, Array, float, float]:
        """Mean, covariance, innovation and its variance, after measurement r."""
        entries = self.rows["c"][r]
        P = np.triu(P) + np.triu(P, 1).T
        PH = [added(a * float(P[i, j]) for j, a in entries) for i in range(self.n)]
        S = added(a * PH[j] for j, a in entries) + var_y
        e = y - added(a * float(X[j]) for j, a in entries)
        inverse = 1.0 / S
        K = [at * inverse for at in PH]
        mean = np.array([float(x) + k * e for x, k in zip(X, K, strict=True)])
        new = np.zeros_like(P)
        for i in range(self.n):
            for j in range(i, self.n):
                new[i, j] = new[j, i] = float(P[i, j]) - K[i] * PH[j]
        return mean, new, e, S
