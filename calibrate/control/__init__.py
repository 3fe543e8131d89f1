"""The command `control`: closed loops of a controller with given gains; nothing is tuned."""
