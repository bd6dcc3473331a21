"""A bearing whose iron saturates, for several tests: the one of DESIGN.md."""

from ambkit import Machine

TOML = """\
name = "iron"
sampling_time = "0.1 ms"

[magnet]
type = "two-sided"
turns = 208
pole_area = "290 mm^2"
pole_angle = "22.5 deg"
air_gap = "0.78 mm"
bias_current = "2.5 A"
iron_length = "0.2 m"
relative_permeability = 2000
saturation = "1.6 T"

[rotor]
mass = "5 kg"
gravity = "-x"
clearance = "0.25 mm"

[amplifier]
gain = "1 A/V"
current_limit = "2.5 A"
noise_variance = "1e-4 V^2"

[sensor]
gain = 1
lag = "0.05 ms"
noise_variance = "1 µm^2"
"""
TWO_SIDED = Machine.from_toml(TOML)
IDEAL = TWO_SIDED.replace(
    magnet__iron_length=None, magnet__relative_permeability=None, magnet__saturation=None
)
ONE_SIDED = TWO_SIDED.replace(magnet__type="one-sided")
