"""The parts of a machine, one file each; what is registered here is composed."""

from ambkit.models.parts.amplifier import Amplifier
from ambkit.models.parts.coloured_noise import ColouredNoise
from ambkit.models.parts.delay import Delay
from ambkit.models.parts.disturbance import Disturbance
from ambkit.models.parts.hum import Hum
from ambkit.models.parts.magnet import MagnetPlace
from ambkit.models.parts.rotor import Rotor
from ambkit.models.parts.sensor import Sensor
from ambkit.models.parts.synchronous import SynchronousForce, SynchronousRunout

PARTS = (Rotor, MagnetPlace, Disturbance, Sensor, Amplifier, Delay, ColouredNoise, Hum)
"""In the order of their states; each takes what concerns it from a bearing (``of_axis``)."""

SENSOR_NOISE = (ColouredNoise, Hum)
"""Those that are noise of the sensor with a memory."""

__all__ = [
    "PARTS",
    "SENSOR_NOISE",
    "Amplifier",
    "ColouredNoise",
    "Delay",
    "Disturbance",
    "Hum",
    "MagnetPlace",
    "Rotor",
    "Sensor",
    "SynchronousForce",
    "SynchronousRunout",
]
