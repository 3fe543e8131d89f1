"""What a finished fit is examined for: the misfit around its end, and what remains in its residuals."""

from ._around import (
    Around as Around,
    ConfidenceInterval as ConfidenceInterval,
    look_around as look_around,
    looking_around as looking_around,
)
from ._profiles import Profile as Profile, Profiles as Profiles, profiling as profiling
from ._remains import VERDICTS as VERDICTS, Remains as Remains, find_remains as find_remains
from ._slices import End as End, Slice as Slice, Slices as Slices, slicing as slicing
from ._weighed import BLOCKS as BLOCKS, Linearised as Linearised, Weighed as Weighed
