"""Numbers of effects, aliens, loops and parameters in the arrays that the compiled routine takes."""

from __future__ import annotations

EFFECTS = (
    "torque_ripple", "direction_asymmetry", "stribeck", "nonlinear_viscous", "position_dependent_friction",
    "gravity_imbalance", "spring", "reversal_memory", "thermal_drift", "elastic_transmission", "backlash",
    "torque_lag", "torque_saturation", "dwell_time_break_away", "load_dependent_friction", "encoder_eccentricity",
)  # fmt: skip
(
    RIPPLE, ASYMMETRY, STRIBECK, CURVED, PLACE, IMBALANCE, SPRING, MEMORY, THERMAL, ELASTIC, GAP, LAG, SATURATION,
    DWELL, LOAD, ECCENTRIC,
) = range(16)  # fmt: skip
LAWS = (3, 2, 3, 3, 3, 2, 3, 2, 3, 2, 2, 3, 3, 3, 4, 2)
"""How many laws each effect has here."""
ALIENS = (
    "crank", "uneven_oil", "mains", "creep", "missing_codes", "neighbour", "hump", "drag", "swirl", "bouc_wen",
    "breathing",
)  # fmt: skip
(CRANK, UNEVEN_OIL, MAINS, CREEP, MISSING_CODES, NEIGHBOUR, HUMP, DRAG, SWIRL, BOUC_WEN, BREATHING) = range(
    1, 12
)
HOST_PID, CASCADE, DRIVE_PID = range(3)
LOOPS = ("host_pid", "cascade", "drive_pid")
(
    INERTIA, VISCOUS, COULOMB, REACH, MICRO, OFFSET, FAMILY, OTHER, SPREAD, POWER, LIMIT, RESOLUTION, CURRENT_TAU,
    TRAVEL, TOP_SPEED, LOAD_INERTIA, LOAD_FRICTION, FADE_LAW, FADE_SPEED, LOW_LAW, LOW_SIZE, LOW_SPEED, LOW_EXPONENT,
) = range(23)  # fmt: skip
PLANT_SIZE = 23
BASES = ("fading", "falling")
"""Other bases: damping of presliding that fades with speed; friction that falls with speed."""
(KIND, KP, KD, KI, FILTER, SPEED_FEED, ACCEL_FEED, DEAD, SUBSAMPLE, CUBIC) = range(10)
LOOP_SIZE = 10
EFFECT_PARAMETERS = 10
WAVES = 6
