"""What a search is asked of the duty where it ends: how it was held, whether it came late, where it jumped."""

from ._delay_response import unanswered as unanswered
from ._duty_questions import asking_beside_edges as asking_beside_edges, asking_of_duty as asking_of_duty
from ._edges import NEAR_ENOUGH as NEAR_ENOUGH, edges_of as edges_of, find_edges as find_edges, moved as moved
from ._readings import reading_both_ways as reading_both_ways
from ._slow_response import unanswered_directions as unanswered_directions
