"""Parts of a machine, one file each; registered here."""

from typing import Any

from ambkit.models.parts.amplifier import Amplifier
from ambkit.models.parts.coloured_noise import ColouredNoise
from ambkit.models.parts.delay import Delay
from ambkit.models.parts.disturbance import Disturbance
from ambkit.models.parts.eddy_current import EddyCurrents, SolidIron
from ambkit.models.parts.line_noise import Hum
from ambkit.models.parts.magnet import MagnetForce
from ambkit.models.parts.rotor import Rotor
from ambkit.models.parts.sensor import Sensor
from ambkit.models.parts.speed_error import SpeedError
from ambkit.models.parts.synchronous import SynchronousForce, SynchronousRunout

BEHIND_MAGNETS: tuple[Any, ...] = (EddyCurrents, SolidIron)
"""Linear parts between a magnet's force and the rotor."""

PARTS = (Rotor, MagnetForce, Disturbance, Sensor, Amplifier, Delay, *BEHIND_MAGNETS)
"""In the order of their states; ``of`` selects what concerns the part from a machine."""

SENSOR_NOISE: tuple[Any, ...] = (ColouredNoise, Hum)  #: Coloured; a filter may leave it out.
ROTATION: tuple[Any, ...] = (SpeedError,)  #: For synchronous states that follow a measured angle.

SYNCHRONOUS: dict[str, Any] = {"unbalance": SynchronousForce, "runout": SynchronousRunout}
"""Synchronous quantities that can be states, by name."""
