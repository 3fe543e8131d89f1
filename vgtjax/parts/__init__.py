"""Physical parts, each an equinox module with its equations."""

from .._types import Scalar as Scalar
from ._air import (
    AbstractIdealGas as AbstractIdealGas,
    Air as Air,
    flow_between as flow_between,
    flow_function as flow_function,
    orifice_flow as orifice_flow,
)
from ._converter import (
    Converter as Converter,
    ConverterState as ConverterState,
    Flow as Flow,
    Plunger as Plunger,
    with_sharp_seat as with_sharp_seat,
    without_chatter as without_chatter,
)
from ._diaphragm import Body as Body, Diaphragm as Diaphragm
from ._gas_effect import feels_gas as feels_gas
from ._gas_table import OPERATING_POINTS as OPERATING_POINTS, AbstractGasTables as AbstractGasTables
from ._stateless import Stateless as Stateless
from ._tabulated import (
    AbstractTabulated as AbstractTabulated,
    Rows as Rows,
    has_tables as has_tables,
    lost_points as lost_points,
    rows_of as rows_of,
    tables_of as tables_of,
    tabulated as tabulated,
    with_tables as with_tables,
)
from ._vanes import Crank as Crank, HasCrank as HasCrank, Vanes as Vanes
from .chamber import *
from .flow_map import *
from .friction import *
from .line import *
from .magnetic_force import *
from .vane_force import *
