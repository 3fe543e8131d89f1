"""The command `sensitivity`: which spread what comes from."""
