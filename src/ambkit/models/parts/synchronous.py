"""What turns with the rotor at its known speed: unbalance, and runout."""

from __future__ import annotations

from dataclasses import dataclass

from ambkit.models.plan import Place, Plan, row


@dataclass(frozen=True)
class SynchronousForce:
    """Unbalance in a plane, which goes round with the rotor: two states, along x and along y."""

    # It pushes with the square of the speed, across with the speed's growth, and keeps its size but
    # for a random walk, slow against everything else. In the frame of the sensors it is a pair that
    # turns by the speed, as that of a generalised notch (Herzog et al., Unbalance compensation
    # using generalized notch filters, 1996).

    size: float
    """Typical unbalance [kg m]."""
    growth: float
    """Typical growth in a sample [kg m]."""
    speed: float
    """Of rotation [rad/s]."""
    name: str
    """Of the states, with _x and _y."""
    along_x: Place
    """The place in its plane, moved along x."""
    along_y: Place
    """And along y."""
    speeding: float = 0.0
    """By how much the speed grows [rad/s^2]."""

    def declare(self, plan: Plan) -> None:
        """Add both states, where they push, and their noise."""
        x, y = f"{self.name}_x", f"{self.name}_y"
        for state, place, across, way in (
            (x, self.along_x, self.along_y, -1.0), (y, self.along_y, self.along_x, 1.0)
        ):  # fmt: skip
            plan.state(state, "kg m", self.size, "unbalance")
            pushed = {q: self.speed**2 * each for q, each in row(place).items()}
            if self.speeding:
                pushed |= {q: way * self.speeding * each for q, each in row(across).items()}
            plan.push(state, pushed)
        _turn(plan, x, y, self.speed)
        grown = dict.fromkeys((x, y), 1 / plan.T)
        plan.noise(self.name, "kg m", self.growth, grown, walk=False)


def _turn(plan: Plan, x: str, y: str, speed: float) -> None:
    plan.rate(x, y, -speed)
    plan.rate(y, x, speed)


@dataclass(frozen=True)
class SynchronousRunout:
    """Runout that sensors of one plane see: two states, a cosine and a sine of the angle."""

    # It enters before the sensors' lag. A sensor farther round by some angle sees the profile by so
    # much later: order n by n times that angle.

    size: float
    """Typical runout [m]."""
    growth: float
    """Typical growth in a sample [m]."""
    speed: float
    """Of rotation [rad/s]."""
    order: int
    """How often a revolution."""
    name: str
    """Of the states, with _c and _s."""
    sensors: tuple[tuple[str, float, float, float, float], ...]
    """Of each sensor that sees it: state of the lagged reading, gain [1], lag [s], and cosine and
    sine of n times the angle by which it is farther round."""

    def declare(self, plan: Plan) -> None:
        """Add both states, their share of the readings, and their noise."""
        c, s = f"{self.name}_c", f"{self.name}_s"
        for state, role in ((c, "runout"), (s, "runout")):
            plan.state(state, "m", self.size, role)
        _turn(plan, c, s, self.order * self.speed)
        for shown, gain, lag, cosine, sine in self.sensors:
            for state, share in ((c, cosine), (s, sine)):
                if share:
                    plan.rate(shown, state, gain * share / lag)
        grown = dict.fromkeys((c, s), 1 / plan.T)
        plan.noise(self.name, "m", self.growth, grown, walk=False)
