"""Names, units and domains of parameters, and the coordinates that an optimiser moves."""

from ._bounds import (
    Bounds as Bounds,
    bounds_by_entry as bounds_by_entry,
    check_bounds as check_bounds,
    move_inside as move_inside,
)
from ._selection import (
    Selection as Selection,
    entry_names as entry_names,
    match_entries as match_entries,
    select as select,
    table_row as table_row,
)
from ._table import (
    AbstractDerived as AbstractDerived,
    Parameter as Parameter,
    Part as Part,
    as_float_array as as_float_array,
    get_parameter as get_parameter,
    nested as nested,
    optional_float_array as optional_float_array,
    parameter as parameter,
    parameter_table as parameter_table,
    replace_parameters as replace_parameters,
    unknown_name as unknown_name,
)
from ._transform import Scale as Scale, Transform as Transform, build_transform as build_transform
