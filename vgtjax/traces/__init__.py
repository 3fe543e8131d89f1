"""What the bench recorded: signals over time, and what they are to a model."""

from ._channel import Channel as Channel, noise_level as noise_level
from ._checks import TRAVEL as TRAVEL
from ._drive import Drive as Drive, Knot as Knot, Ramp as Ramp, Start as Start
from ._duty import delay_duty as delay_duty
from ._load import load_trace as load_trace
from ._noise import MOVES as MOVES, drift_of as drift_of, remove_noise as remove_noise
from ._robust import robust_deviation as robust_deviation
from ._signals import SIGNALS as SIGNALS, Signal as Signal
from ._source import Source as Source
from ._trace import (
    ASSUMED_RESERVOIR as ASSUMED_RESERVOIR,
    SENSOR_PRESSURE_OFFSET as SENSOR_PRESSURE_OFFSET,
    STANDARD_ATMOSPHERE as STANDARD_ATMOSPHERE,
    START_WINDOW as START_WINDOW,
    Trace as Trace,
    cast as cast,
    require as require,
)
from ._units import UNITS as UNITS
from .files import (
    Entry as Entry,
    Record as Record,
    Recording as Recording,
    reading as reading,
    register_reader as register_reader,
    require_start as require_start,
    trace_suffixes as trace_suffixes,
)
