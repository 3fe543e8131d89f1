"""The application: study files, batch jobs, reports and the command line.

What is wrong with input raises `InputError` wherever it is found, with the sentence that the user reads and before
anything is written; what a computation can't do raises `SimulationError`, after everything else is written.
"""
