"""The command `fit`: calibrates every unit of a study."""
