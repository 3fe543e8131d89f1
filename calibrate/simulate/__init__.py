"""The command `simulate`: the model on every trace of a study."""
