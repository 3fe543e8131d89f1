"""What the user asks for: study files, parameters of earlier fits, and the actuators that they describe."""

from .read import load_study as load_study
from .tables import Study as Study
from .units import Job as Job, Unit as Unit, prepare as prepare
