"""What states are to the core, which must find a lost rotor again (``ambkit/envelope.h``)."""

POSITION, VELOCITY, SHOWN, LOAD, KNOWN, NOISE = ENUMERATORS = (
    "AMB_POSITION", "AMB_VELOCITY", "AMB_SHOWN", "AMB_LOAD", "AMB_KNOWN", "AMB_NOISE",
)  # fmt: skip
"""The enumerators of ``amb_role`` (``ambkit/role.h``), in their order there."""

ROLES = {
    "position": POSITION, "velocity": VELOCITY, "sensor": SHOWN, "disturbance force": LOAD,
    "noise": NOISE, "noise in quadrature": NOISE, "unbalance": NOISE, "runout": NOISE,
    "bending": NOISE, "bending velocity": NOISE, "lagged force": NOISE,
    "current": KNOWN, "past control": KNOWN,
}  # fmt: skip
"""What the core calls the roles of a model's states.

A bending is no position to it: a reading shows where the rotor is, and not how it is bent.
"""
