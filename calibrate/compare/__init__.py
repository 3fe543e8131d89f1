"""The command `compare`: which structures the traces favour."""
