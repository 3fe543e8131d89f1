"""Levenberg-Marquardt from a start, or from many, to where the misfit is least."""

from ._abstract_calibrator import AbstractCalibrator as AbstractCalibrator, C as C
from ._beginning import first_progress as first_progress, problem_of as problem_of, transform_of as transform_of
from ._corrections import correcting as correcting
from ._many_starts import from_many_starts as from_many_starts
from ._noise_met import meets_noise as meets_noise, most_left as most_left
from ._point import Point as Point, misfit_at as misfit_at
from ._progress import (
    CHI2_TOLERANCE as CHI2_TOLERANCE,
    Progress as Progress,
    Report as Report,
    StartEnded as StartEnded,
    quiet as quiet,
)
from ._search import SPREAD as SPREAD, LevenbergMarquardt as LevenbergMarquardt
from ._searches import (
    beginning_again as beginning_again,
    from_second_guess as from_second_guess,
    giving_up as giving_up,
    searching as searching,
    searching_once as searching_once,
    without_ceiling as without_ceiling,
)
from ._slopes import (
    FARTHEST as FARTHEST,
    Slopes as Slopes,
    by_delay_alone as by_delay_alone,
    places_around as places_around,
)
from ._starts import REACHED as REACHED
