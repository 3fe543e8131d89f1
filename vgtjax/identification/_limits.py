"""The limits of identification: what decides whether a test can be done, and whether a value is believed.

Settings that only make an algorithm accurate or fast (kernels, windows, steps) stand beside that algorithm, and what
decides between structures, which is evidence and no limit of a test, in `structures/_ranking.py`.
"""

from ..estimation import SEGMENT
from ..experiments import SAME_POINT


class Limit(float):
    """A number with its unit (empty for a count or a ratio) and the reason for it."""

    unit: str
    reason: str

    def __new__(cls, value: float, unit: str, reason: str) -> "Limit":
        """A float that knows what it is for."""
        limit = super().__new__(cls, value)
        limit.unit, limit.reason = unit, reason
        return limit


# -- whether a value is believed: relative standard errors, and how far it may move ------------------------------------

ERROR = Limit(0.3, "", "relative standard error above which the model's own value is as good")
ERROR_RESPONSE = Limit(0.2, "", "the same in fits of all parameters at once, where vague ones spoil their neighbours")
ERROR_SPRING = Limit(0.5, "", "the same for preload and spring, which later tests need more than they need them exact")
ERROR_START = Limit(0.5, "", "the same for a value that is only the start of a fit")
ERROR_PULL = Limit(0.03, "", "of the full pull anywhere from 0 to 100 %; above, a quartic is more than holds carry")
FACTOR_AREAS = Limit(10, "", "by which areas and volume may leave their start, or a wild trial never returns")
FACTOR_PLUNGER = Limit(
    3, "", "the same for converter and chamber: only the plunger's mass keeps them from growing alike"
)
FACTOR_RESPONSE = Limit(30, "", "the same for diaphragm and friction: where data say little, values run to infinity")
SENSITIVITY = Limit(1e9, "deviations", "of a sample when a parameter changes by its own size; more is chaos, no slope")
MISFIT = Limit(1.5, "", "residuals over sensor noise; above, the model lacks something")
INFLATION = Limit(1e8, "", "of a variance by columns of measured signals, whose own noise hides finer differences")
METHOD_ERROR = Limit(1e-3, "", "relative error of areas and volume from noise-free traces of known parameters")

# -- what is known before a test ---------------------------------------------------------------------------------------

STOP_ERROR = Limit(0.1, "", "by which a stop's assumed stiffness may be wrong; it sets how deep preload presses")
LIFT_FORCE_ERROR = Limit(0.5, "", "relative error of the model's stiffness over orifice slope before any trace")
IDLE_PULL_ERROR = Limit(0.05, "N", "error of the model's pull without duty, a remanence, before any trace")
POSITION_ERROR = Limit(0.25e-3, "m", "offset of a position sensor that was never seen at a known place")
LIFT_ERROR = Limit(2e-6, "m", "plunger position by balance at best: 5 mN of magnetic force, a pressure's offset")
SEATING = Limit(1e-6, "m", "place of a closed plunger; on noise-free traces its force is off by as much")

# -- how long residuals stay alike -------------------------------------------------------------------------------------

CORRELATION = Limit(0.25, "s", "after which friction and smoothed noise of a sprung rod have changed")
CORRELATION_FREE = Limit(2.5, "s", "the same without a spring, whose position remembers every error of the force")
CORRELATION_FLOW = Limit(0.5, "s", "the same for flows: longer than any window of the filters")
CORRELATION_PLUNGER = Limit(4 * SEGMENT, "samples", "the same in fits of the pressure: whole lanes of their residuals")

# -- rest, steps and holds ---------------------------------------------------------------------------------------------

REST_SAMPLES = Limit(5, "samples", "at rest from which a sensor's offset can be read")
REST_DRIFT = Limit(5, "errors", "between the halves of a rest; more is the end of a movement")
REST_SPEED = Limit(0.02, "", "of the greatest speed; less at the first sample counts as rest")
START_TIME = Limit(0.02, "s", "over which the speed at the first sample is read, before a force has changed it")
START_SAMPLES = Limit(8, "samples", "the same, so that noise averages out")
MOVING = Limit(5, "deviations", "of the velocity's noise beyond which the rod certainly moves")
RANGE = Limit(20, "deviations", "of its noise over which a position must range, or the rod counts as still")
DUTY_STEP = Limit(2, "%", "change between samples that is a step; a ramp's are smaller")
SAME_DUTY = Limit(1, "%", "holds nearer than this are one duty")
HOLD_SETTLING = Limit(0.05, "s", "after a step in which the plunger moves: several times damping over stiffness")
HOLD_TIME = Limit(0.1, "s", "what must be left of a hold to count as an equilibrium")
HOLD_LIFT = Limit(20e-6, "m", "lift by the model up to which a hold counts as settled")
RAMP_TIME = Limit(0.25, "s", "of a ramp that make one equilibrium: enough for the pressure's slope")
RAMP_LIFT = Limit(300e-6, "m", "lift by the model up to which a ramp counts as quasi-static")
RAMP_RATE = Limit(20, "%/s", "of the duty; faster, the plunger's lag counts")
RAMP_ROUGHNESS = Limit(0.3, "%", "by which the duty of a ramp may leave a straight line")
FLOW_SETTLING = Limit(0.02, "s", "around a step in which smoothing and the plunger's mass blur its position")
MAP_SETTLING = Limit(0.03, "s", "after a change of duty for a flow map; the plunger's lag is 11 ms")
MAP_DUTIES = Limit(3, "duties", "that a flow map needs: two leave open how it bends over the duty")

# -- flow and pressure -------------------------------------------------------------------------------------------------

FLOW_LIFT = Limit(10e-6, "m", "below, the plunger's position is no better known than to its size")
FLOW_MARGIN = Limit(
    2000, "Pa", "between chamber and source; nearer, flow goes with their difference, not with the area"
)
FLOW_LEAST = Limit(1e-3, "", "of the choked flow; a slower one determines no area")
CLOSED_MARGIN = Limit(1500, "Pa", "from reservoir and atmosphere; nearer, the plunger need not be closed")

# -- a rod that slides or turns ----------------------------------------------------------------------------------------

SLIDING_SAMPLES = Limit(30, "samples", "of one-way sliding that a regression needs")
TURNING_SAMPLES = Limit(50, "samples", "of motion with turns that a regression needs")
HELD_SAMPLES = Limit(20, "samples", "at the closed stop from which its place can be read")
HELD_FORCE = Limit(2, "", "Coulomb forces of excess drive before a rod at rest counts as held by its stop")
STICKING = Limit(0.05, "", "part of a kernel over which an axis may stick, when friction has no known value")
MEMORY = Limit(8, "", "bristle deflections after which a turn is forgotten, to a part in three thousand")
STOP_MARGIN = Limit(0.02, "", "of the travel near either stop that is left out: the stop may touch")
STOP_NOISE = Limit(10, "deviations", "of the position's noise that are left out there at least")

# -- vane force --------------------------------------------------------------------------------------------------------

VANE_STOP_MARGIN = Limit(0.5e-3, "m", "from a stop; nearer, the rod reverses")
VANE_SLOWEST = Limit(5e-5, "m/s", "slower, the direction of motion is noise")
VANE_FASTEST = Limit(5e-3, "m/s", "faster, inertia and damping are no longer small")
NO_GAS = Limit(2e3, "Pa", "gauge; below, exhaust gas does nothing that a position sensor could see")
SAME_TURBINE = Limit(SAME_POINT, "Pa", "turbine pressures nearer than this are one, as the bench holds them only about")

LIMITS: dict[str, Limit] = {name: value for name, value in globals().items() if isinstance(value, Limit)}
"""Every limit by name."""
