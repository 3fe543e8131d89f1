"""What studies of a population share: the job, its chunks on disk, and how outputs are shown."""

from .actuators import Actuators as Actuators, read_actuators as read_actuators
from .chunks import ChunkStore as ChunkStore
from .job import PopulationJob as PopulationJob, prepare_population as prepare_population
from .outputs import (
    describe_active as describe_active,
    describe_failed as describe_failed,
    describe_quantities as describe_quantities,
    say_active as say_active,
    scaled as scaled,
)
from .sweep import Plan as Plan, carry_out as carry_out
