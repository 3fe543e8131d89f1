"""The command `check`: what can be known from the traces of a study, and which run to record next."""
