"""What a closed loop is put through: references, sensors and what fails in them, and what disturbs the plant."""

from ._disturbances import (
    AbstractAlteration as AbstractAlteration,
    AbstractDisturbance as AbstractDisturbance,
    AbstractDutyPath as AbstractDutyPath,
    AbstractSensorFault as AbstractSensorFault,
    AbstractSurroundings as AbstractSurroundings,
    Disturbed as Disturbed,
)
from ._engine_disturbances import CoilSupply as CoilSupply, LateDuty as LateDuty, TurbinePulsation as TurbinePulsation
from ._recurring import Draws as Draws, Periodic as Periodic
from ._reference import (
    SIGNAL_1_PERIOD as SIGNAL_1_PERIOD,
    AbstractSignal as AbstractSignal,
    Constant as Constant,
    FadeIn as FadeIn,
    Later as Later,
    Ramps as Ramps,
    Sampled as Sampled,
    Sine as Sine,
    Steps as Steps,
    number as number,
    reference_at as reference_at,
    signal_1 as signal_1,
    signal_2 as signal_2,
)
from ._scenario import Scenario as Scenario, at_rest as at_rest, balanced_at as balanced_at
from ._sensor_faults import LostSensor as LostSensor, StuckSensor as StuckSensor
from ._sensors import (
    POSITION_NOISE as POSITION_NOISE,
    PRESSURE_NOISE as PRESSURE_NOISE,
    Sensor as Sensor,
    Sensors as Sensors,
)
