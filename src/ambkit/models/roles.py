"""What states are to the core, which must find a lost rotor again (``ambkit/envelope.h``)."""

POSITION, VELOCITY, SHOWN, LOAD, KNOWN = ENUMERATORS = (
    "AMB_POSITION", "AMB_VELOCITY", "AMB_SHOWN", "AMB_LOAD", "AMB_KNOWN",
)  # fmt: skip
"""The enumerators of ``amb_role`` (``ambkit/model.h``), in their order there."""

ROLES = {
    "position": POSITION, "velocity": VELOCITY, "sensor": SHOWN, "disturbance force": LOAD,
    "noise": LOAD, "noise in quadrature": LOAD, "current": KNOWN, "past control": KNOWN,
}  # fmt: skip
"""What the core calls the roles of a model's states."""
