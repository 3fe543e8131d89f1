"""What studies of a population share: the job, its chunks on disk, processes, and how outputs are shown."""

from .actuators import Actuators as Actuators, read_actuators as read_actuators
from .chunks import ChunkStore as ChunkStore
from .job import PopulationJob as PopulationJob, prepare_population as prepare_population
from .outputs import scaled as scaled
from .processes import agree as agree, join as join, leads as leads, together as together
from .quantities import describe_failed as describe_failed, describe_quantities as describe_quantities
from .sweep import Plan as Plan, carry_out as carry_out
