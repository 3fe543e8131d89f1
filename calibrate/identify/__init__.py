"""The command `identify`: one bench test after the other."""
