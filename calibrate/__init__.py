"""The application: study files, batch jobs, reports and the command line.

What is wrong with input raises `InputError` wherever it is found, with the sentence that the user reads and before
anything is written; what a computation can't do raises `SimulationError`, after everything else is written.
"""

import os

# Matrices here are tall and narrow: a second thread of BLAS gains nothing, and where simulations keep the cores busy
# its threads wait for each other, half of the time of an identification. Once NumPy is loaded, too late.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
