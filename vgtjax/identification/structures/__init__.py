"""Which structure the traces favour."""

from ._ranking import (
    Duel as Duel,
    RankedStructure as RankedStructure,
    StructureRanking as StructureRanking,
    worst_verdict as worst_verdict,
)
from ._structures import (
    Ahead as Ahead,
    Begin as Begin,
    Compared as Compared,
    Structure as Structure,
    compare_structures as compare_structures,
    comparing_structures as comparing_structures,
    nothing_ahead as nothing_ahead,
)
