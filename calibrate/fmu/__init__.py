"""Functional mock-up units: a model as C that no Python is needed for, in the format of FMI 2.0."""
