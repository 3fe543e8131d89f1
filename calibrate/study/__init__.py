"""What the user asks for: study files, parameters of earlier fits, and the actuators that they describe."""
