"""The command `flow`: what one-dimensional flow through the variable nozzle says of its force on the rod."""
