"""The head of the study that the file format's documentation prints."""

HEAD = """
name = "unit A, cold bench"
model = "full"

[components]
friction = "lugre"
vane_force = "none"
line = "none"
magnetic_force = "static"
chamber = "adiabatic"
"""
