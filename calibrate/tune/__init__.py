"""The command `tune`: gains of a controller, tuned through the gradient of its closed loops."""
