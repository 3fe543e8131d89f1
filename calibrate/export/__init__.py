"""The command `export`: a calibrated model as data sets of control units, tables, and models for other tools."""
