"""From measurements to a bearing: force and magnet constant, stiffnesses, noise, lift-off."""

from ambkit.identification.online.magnet_constant import Identification, identify

__all__ = ["Identification", "identify"]
