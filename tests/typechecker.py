"""Annotations are checked while the tests run."""

import beartype

checked = beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))  # an int is a float, as to mypy
