"""The command `tolerance`: a Monte Carlo study."""
